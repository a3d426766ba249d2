"""Rays through parallel planes, front to back, in Warp; the Taichi set has the equations.

A thread takes a ray, on the CPU a slab of rays. The gradients of samples are stored. Then, on the
CPU, one thread adds those of a plane in the order of the rays; on CUDA a thread takes one sample,
and the order has no effect on integer sums.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, view
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance._structs import Rays, Seen

from . import _rays_cuda as cuda
from ._path import FIRST, corner_of, distance_of, path_of
from ._shine import Shine, shift_of
from ._sums import scatterer, shine_scatterer

OPTIONS = {"enable_backward": False}
wp.set_module_options(OPTIONS)

LANES = wp.constant(wp.uint64(0x00FF00FF00FF00FF))
LOW, HIGH = wp.constant(wp.uint32(0x00FF00FF)), wp.constant(wp.uint32(0xFF00FF00))
BYTE = wp.constant(1.0 / (255.0 * 256.0))  # one, in sums of bytes with weights of 256 in all


@wp.func
def texel_of(
    texels: wp.array3d[wp.vec4], plane: int, row: int, column: int, down: float, right: float
) -> wp.vec4:
    """Interpolate between four texels."""
    upper = texels[plane, row, column] * (1.0 - right) + texels[plane, row, column + 1] * right
    lower = (
        texels[plane, row + 1, column] * (1.0 - right) + texels[plane, row + 1, column + 1] * right
    )
    return upper * (1.0 - down) + lower * down


@wp.func
def spread(texel: wp.uint32) -> wp.uint64:
    """Return the bytes of a texel in the order red, blue, green, alpha, one in 16 bits each."""
    return wp.uint64(texel & LOW) | (wp.uint64(texel & HIGH) << wp.uint64(24))


@wp.func
def texel_of_bytes(
    texels: wp.array3d[wp.uint32], plane: int, row: int, column: int, down: float, right: float
) -> wp.vec4:
    """Interpolate between four texels of 8 bits, with weights of 1 / 256 as a GPU's textures."""
    a = texels[plane, row, column]
    b = texels[plane, row, column + 1]
    c = texels[plane, row + 1, column]
    d = texels[plane, row + 1, column + 1]
    found = wp.vec4(0.0, 0.0, 0.0, 0.0)
    if (a | b | c | d) != wp.uint32(0):
        x = int(right * 256.0 + 0.5)
        y = int(down * 256.0 + 0.5)
        both = (x * y + 128) >> 8
        total = (
            spread(a) * wp.uint64(256 - x - y + both)
            + spread(b) * wp.uint64(x - both)
            + spread(c) * wp.uint64(y - both)
            + spread(d) * wp.uint64(both)
        )
        low = int(total & wp.uint64(0xFFFFFFFF))
        high = int(total >> wp.uint64(32))
        found = BYTE * wp.vec4(
            float(low & 0xFFFF),
            float(high & 0xFFFF),
            float((low >> 16) & 0xFFFF),
            float((high >> 16) & 0xFFFF),
        )
    return found


@cache
def renderer(texel: Any, shiny: bool) -> wp.Kernel:
    """Return the kernel for texels of a kind."""
    fetch = texel_of_bytes if texel is wp.uint32 else texel_of

    @wp.kernel(module="unique", module_options=OPTIONS)
    def render(
        stride: int,
        first: int,
        last: int,
        rays: Rays,
        planes: wp.array[float],  # (16 + D,)
        texels: wp.array3d[texel],  # (D, H, W)
        shine: Shine,
        stop: float,
        # outputs
        seen: Seen,
    ):
        height = texels.shape[1]
        width = texels.shape[2]
        for ray in range(first + wp.tid(), last, stride):
            if ray < rays.active[0]:
                path = path_of(planes, rays, ray)
                color = wp.vec3(0.0, 0.0, 0.0)
                depth = float(0.0)
                through = float(1.0)
                plane = int(0)
                while plane < texels.shape[0]:
                    q = planes[FIRST + plane]
                    at = corner_of(path, q, height, width)
                    if at.inside:
                        t = fetch(texels, plane, at.row, at.column, at.down, at.right)
                        if t[3] > 0.0:
                            own = wp.vec3(t[0], t[1], t[2])
                            if wp.static(shiny):
                                own += t[3] * shift_of(shine, path, q, plane, at)
                            color += through * own
                            depth += through * t[3] * distance_of(path, q)
                            through *= 1.0 - t[3]
                            if through <= stop:
                                plane = texels.shape[0]
                    plane += 1
                for k in range(3):
                    seen.color[ray, k] = color[k]
                seen.opacity[ray] = 1.0 - through
                seen.depth[ray] = depth

    return render


def render(
    rays: codes.Rays,
    planes: wp.array,
    texels: wp.array,
    shine: codes.Shine | None,
    stop: float,
    row: int,
    seen: codes.Seen,
) -> None:
    """Render the first `active` rays; a ray ends where at most the share `stop` of light is left.

    `texels` are (D, H, W, 4) float32, or (D, H, W) uint32 with the bytes red, green, blue, alpha
    from the lowest on; colours are premultiplied, H and W at least 2. Texels of 8 bits are
    interpolated with weights that are multiples of 1 / 256, and must not change after they were
    first rendered: on CUDA their empty parts are remembered. `row` is the width of the picture if
    the rays are those of its pixels, row by row, or 0.
    """
    count = rays.origins.shape[0]
    if len(texels.shape) == 4:
        texels = view(texels, wp.vec4, texels.shape[:3])
    inputs = [struct_of(Rays, rays), planes, texels, _shine(shine), stop]
    words = texels.device.is_cuda and texels.dtype is wp.uint32
    if words and shine is None and texels.shape[0] <= cuda.MOST:
        stack = cuda.stack_of(texels)
        sheet = wp.uint64(stack.sheet.cuda_texture)
        given = [count, row, *inputs[:3], stack.filled, sheet, stack.columns, stop]
        launch(cuda.render_bytes, cuda.threads(count, row), given, [struct_of(Seen, seen)])
        return
    launch_each(
        renderer(texels.dtype, shine is not None), count, 8 * texels.shape[0] * count, inputs,
        [struct_of(Seen, seen)],
    )  # fmt: skip


def _shine(shine: codes.Shine | None) -> Any:
    """Return the coefficients as a Warp structure, of an empty array if there are none."""
    return Shine() if shine is None else struct_of(Shine, shine)


@wp.kernel
def trace_kernel(
    stride: int,
    first: int,
    last: int,
    d_seen: Seen,
    rays: Rays,
    planes: wp.array[float],  # (16 + D,)
    texels: wp.array3d[wp.vec4],  # (D, H, W)
    shine: Shine,
    stop: float,
    seen: Seen,
    # outputs
    records: wp.array2d[wp.vec4],  # (D, R): gradients of the samples
    weights: wp.array2d[float],  # (D, R): their opacities; filled if there is a shine
):
    """Walk a ray again, and store the gradients of its samples."""
    height = texels.shape[1]
    width = texels.shape[2]
    count = texels.shape[0]
    for ray in range(first + wp.tid(), last, stride):
        if ray < rays.active[0]:
            path = path_of(planes, rays, ray)
            g = wp.vec3(d_seen.color[ray, 0], d_seen.color[ray, 1], d_seen.color[ray, 2])
            g_opacity = d_seen.opacity[ray]
            g_depth = d_seen.depth[ray]
            c = wp.vec3(seen.color[ray, 0], seen.color[ray, 1], seen.color[ray, 2])
            rest = wp.dot(g, c) + g_opacity * seen.opacity[ray] + g_depth * seen.depth[ray]
            through = float(1.0)
            for plane in range(count):
                record = wp.vec4(0.0, 0.0, 0.0, 0.0)
                weight = float(0.0)
                if through > stop:
                    q = planes[FIRST + plane]
                    at = corner_of(path, q, height, width)
                    if at.inside:
                        t = texel_of(texels, plane, at.row, at.column, at.down, at.right)
                        slope = g_opacity + g_depth * distance_of(path, q)
                        left = 1.0 - t[3]
                        if shine.maps.shape[3] > 0:
                            slope += wp.dot(g, shift_of(shine, path, q, plane, at))
                            weight = t[3]
                        rest -= through * (wp.dot(g, wp.vec3(t[0], t[1], t[2])) + t[3] * slope)
                        behind = float(0.0)
                        if through * left > stop:  # otherwise the ray ends here
                            behind = rest / left
                        record = wp.vec4(
                            through * g[0], through * g[1], through * g[2], through * slope - behind
                        )
                        through *= left
                records[plane, ray] = record
                if shine.maps.shape[3] > 0:
                    weights[plane, ray] = weight


def render_backward(
    d_seen: codes.Seen,
    rays: codes.Rays,
    planes: wp.array,
    texels: wp.array,
    shine: codes.Shine | None,
    stop: float,
    seen: codes.Seen,
    d_texels: wp.array,
    d_maps: wp.array | None,
) -> None:
    """Add the gradients of the texels to `d_texels` (D, H, W, 4).

    `d_seen` are gradients by the results of :func:`render` for the same rays, `texels` in float32,
    and `seen`. The end of a ray is treated as constant. With a `shine`, add the gradients of its
    maps to `d_maps`, of the same shape. On CUDA these two may be int64, for fixed-point numbers,
    whose sums do not depend on the order.
    """
    count, number = rays.origins.shape[0], texels.shape[0]
    device = d_texels.device
    records = scratch("planes.records", (number, count), wp.vec4, device)
    room = (1, 1) if shine is None else (number, count)
    weights = scratch("planes.weights", room, wp.float32, device)
    given, maps = (struct_of(Rays, rays), planes), _shine(shine)
    packed = view(texels, wp.vec4, texels.shape[:3])
    inputs = [struct_of(Seen, d_seen), *given, packed, maps, stop, struct_of(Seen, seen)]
    launch_each(trace_kernel, count, 16 * number * count, inputs, [records, weights])
    serial = not device.is_cuda
    kernel = scatterer(d_texels.dtype, serial)
    if serial:
        launch_slabs(kernel, number, number, [*given, records], [d_texels])
    else:
        launch(kernel, (number, count), [*given, records], [d_texels])
    if d_maps is None:
        return
    kernel = shine_scatterer(d_maps.dtype, serial)
    inputs = [*given, wp.vec2i(*texels.shape[1:3]), records, weights, maps]
    if serial:
        launch_slabs(kernel, d_maps.shape[0], number, inputs, [d_maps])
    else:
        launch(kernel, (number, count), inputs, [d_maps])
