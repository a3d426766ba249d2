"""Rays through parallel planes, front to back, in Taichi; one thread per ray.

Planes are parallel to the image of a reference camera. The array `planes` (16 + D,) has the map of
the frame to its axes, a row of 4 for each, then fx, fy, cx, cy, and then 1 / depth of each plane,
the nearest first. A texel has premultiplied colours and an opacity (c, a), interpolated linearly
between the centres of four texels. The outermost texels go on for half a texel. In the camera's
axes, with s = (d_x / d_z, d_y / d_z), a ray o + t d meets the plane of disparity q at the texel

    (x, y) = f (s + q (o_xy - o_z s)) + c,    t = (1 - q o_z) / (q d_z),

linear in q: the homography of the plane. Rays with d_z <= 0 meet nothing, nor do planes behind the
origin count. With T_i = prod_{j < i} (1 - a_j), the ray has C = sum T_i c_i, O = sum T_i a_i,
D = sum T_i a_i t_i, and ends where T_i falls to `stop`. For gradients g by these,

    dL/dc_i = T_i g_C,    dL/da_i = T_i (g_O + g_D t_i) - S_i / (1 - a_i),
    S_i = sum_{j > i} T_j (<g_C, c_j> + a_j (g_O + g_D t_j)),

and a texel has the gradient of each sample times its share in it. S_i is what is left of
<g_C, C> + g_O O + g_D D after the samples up to i. The gradients of samples are stored. Then, on
the CPU, one thread adds those of a plane in the order of the rays; on CUDA a thread takes one
sample, and the order has no effect on integer sums.
"""

from typing import Any

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.codes.radiance import PLANES_PLACE
from cvkern.kernels.taichi._launch import on_cpu, primitive, scratch
from cvkern.kernels.taichi.radiance._fixed_point import add

from ._path import Corner, Path, corner_of, distance_of, path_of, share_of
from ._shine import Rule, place_of, shift_of, side_of
from ._totals import total

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f32_4 = ti.types.ndarray(dtype=ti.f32, ndim=4)
u32_3 = ti.types.ndarray(dtype=ti.u32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
vec3 = ti.types.vector(3, ti.f32)
vec4 = ti.types.vector(4, ti.f32)


@ti.func
def _texel(texels: ti.template(), plane: ti.i32, at: Corner) -> vec4:
    """Interpolate between four texels."""
    found = vec4(0.0)
    for i, j in ti.static(ti.ndrange(2, 2)):
        share = share_of(at, i, j)
        for k in ti.static(range(4)):
            found[k] += share * texels[plane, at.row + i, at.column + j, k]
    return found


@ti.func
def _texel_of_bytes(texels: ti.template(), plane: ti.i32, at: Corner) -> vec4:
    """Interpolate between four texels of 8 bits, with weights of 1 / 256 as a GPU's textures."""
    x = ti.cast(at.right * 256.0 + 0.5, ti.i32)
    y = ti.cast(at.down * 256.0 + 0.5, ti.i32)
    both = (x * y + 128) >> 8
    total = ti.Vector([0, 0, 0, 0])
    for i, j in ti.static(ti.ndrange(2, 2)):
        texel = texels[plane, at.row + i, at.column + j]
        weight = 256 - x - y + both
        if ti.static(i == 0 and j == 1):
            weight = x - both
        elif ti.static(i == 1 and j == 0):
            weight = y - both
        elif ti.static(i == 1 and j == 1):
            weight = both
        for k in ti.static(range(4)):
            total[k] += weight * ti.cast((texel >> ti.u32(8 * k)) & ti.u32(255), ti.i32)
    return ti.cast(total, ti.f32) / (255.0 * 256.0)


@ti.kernel
def _render(
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
    active: i32_1,  # (1,)
    planes: f32_1,  # (16 + D,)
    small: ti.template(),
    values: f32_4,  # (D, H, W, 4), read unless `small`
    words: u32_3,  # (D, H, W), read if `small`
    maps: f32_4,  # (G, h, w, 3 N)
    rule: Rule,
    # outputs
    colors: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    depths: f32_1,  # (R,)
):
    for ray in range(ti.min(active[0], origins.shape[0])):
        path = path_of(planes, origins, directions, ray)
        height = values.shape[1]
        width = values.shape[2]
        if ti.static(small):
            height = words.shape[1]
            width = words.shape[2]
        color = vec3(0.0)
        depth = 0.0
        through = 1.0
        for plane in range(planes.shape[0] - PLANES_PLACE):
            q = planes[PLANES_PLACE + plane]
            at = corner_of(path, q, height, width)
            if at.inside == 1 and through > rule.stop:
                t = vec4(0.0)
                if ti.static(small):
                    t = _texel_of_bytes(words, plane, at)
                else:
                    t = _texel(values, plane, at)
                if t[3] > 0.0:
                    own = vec3(t[0], t[1], t[2])
                    if maps.shape[3] > 1:
                        own += t[3] * shift_of(maps, rule, path, q, plane, at)
                    color += through * own
                    depth += through * t[3] * distance_of(path, q)
                    through *= 1.0 - t[3]
        for k in ti.static(range(3)):
            colors[ray, k] = color[k]
        opacity[ray] = 1.0 - through
        depths[ray] = depth


@primitive
def render(
    rays: codes.Rays,
    planes: np.ndarray,
    texels: np.ndarray,
    shine: codes.Shine | None,
    stop: float,
    row: int,
    seen: codes.Seen,
) -> None:
    """Render the first `active` rays; a ray ends where at most the share `stop` of light is left.

    `texels` are (D, H, W, 4) float32, or (D, H, W) uint32 with the bytes red, green, blue, alpha
    from the lowest on; colours are premultiplied, H and W at least 2. Texels of 8 bits are
    interpolated with weights that are multiples of 1 / 256, and must not change after they were
    first rendered. `row` is the width of the picture if the rays are those of its pixels, row by
    row, or 0; here it makes no difference.
    """
    small = texels.dtype == np.uint32
    other = scratch((1, 1, 1, 1) if small else (1, 1, 1), np.float32 if small else np.uint32)
    values, words = (other, texels) if small else (texels, other)
    _render(*rays, planes, small, values, words, *_given(shine, stop), *seen)


def _given(shine: codes.Shine | None, stop: float) -> tuple[np.ndarray, Any]:
    """Return the coefficients, or one number instead, which is not read, and the other numbers."""
    if shine is None:
        return scratch((1, 1, 1, 1), np.float32), Rule(shared=1, reach=1.0, stop=stop)
    return shine.maps, Rule(shared=shine.shared, reach=shine.reach, stop=stop)


@ti.kernel
def _trace(
    d_color: f32_2,  # (R, 3)
    d_opacity: f32_1,  # (R,)
    d_depth: f32_1,  # (R,)
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
    active: i32_1,  # (1,)
    planes: f32_1,  # (16 + D,)
    texels: f32_4,  # (D, H, W, 4)
    maps: f32_4,  # (G, h, w, 3 N)
    rule: Rule,
    totals: f32_1,  # (R,): <g_C, C> + g_O O + g_D D
    # outputs
    records: f32_3,  # (D, R, 5): gradients of the samples, and their opacities
):
    for ray in range(ti.min(active[0], origins.shape[0])):
        path = path_of(planes, origins, directions, ray)
        g = vec3(d_color[ray, 0], d_color[ray, 1], d_color[ray, 2])
        rest = totals[ray]
        through = 1.0
        for plane in range(planes.shape[0] - PLANES_PLACE):
            record = vec4(0.0)
            records[plane, ray, 4] = 0.0
            q = planes[PLANES_PLACE + plane]
            at = corner_of(path, q, texels.shape[1], texels.shape[2])
            if at.inside == 1 and through > rule.stop:
                t = _texel(texels, plane, at)
                slope = d_opacity[ray] + d_depth[ray] * distance_of(path, q)
                left = 1.0 - t[3]
                if maps.shape[3] > 1:
                    slope += g.dot(shift_of(maps, rule, path, q, plane, at))
                records[plane, ray, 4] = t[3]
                rest -= through * (g.dot(vec3(t[0], t[1], t[2])) + t[3] * slope)
                record = through * vec4(g[0], g[1], g[2], slope)
                if through * left > rule.stop:  # otherwise the ray ends here
                    record[3] -= rest / left
                through *= left
            for k in ti.static(range(4)):
                records[plane, ray, k] = record[k]


@ti.func
def _scatter_one(
    origins: ti.template(),
    directions: ti.template(),
    planes: ti.template(),
    records: ti.template(),
    plane: ti.i32,
    ray: ti.i32,
    exact: ti.template(),
    sums: ti.template(),
):
    """Add the gradient of a sample to its texels."""
    r = vec4(0.0)
    for k in ti.static(range(4)):
        r[k] = records[plane, ray, k]
    if r[0] != 0.0 or r[1] != 0.0 or r[2] != 0.0 or r[3] != 0.0:
        path = path_of(planes, origins, directions, ray)
        at = corner_of(path, planes[PLANES_PLACE + plane], sums.shape[1], sums.shape[2])
        for i, j in ti.static(ti.ndrange(2, 2)):
            share = share_of(at, i, j)
            for k in ti.static(range(4)):
                add(sums[plane, at.row + i, at.column + j, k], share * r[k], exact)


@ti.kernel
def _scatter(
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
    active: i32_1,  # (1,)
    planes: f32_1,  # (16 + D,)
    records: f32_3,  # (D, R, 5)
    threads: ti.i32,
    exact: ti.template(),
    # outputs
    sums: ti.types.ndarray(ndim=4),  # (D, H, W, 4), int64 if exact: added to
):
    for plane, thread in ti.ndrange(planes.shape[0] - PLANES_PLACE, threads):
        rays = ti.min(active[0], origins.shape[0])
        for turn in range((rays - thread + threads - 1) // threads):
            ray = thread + turn * threads
            _scatter_one(origins, directions, planes, records, plane, ray, exact, sums)


@ti.func
def _scatter_side(
    path: Path, plane: ti.i32, ray: ti.i32, at: Corner, disparity: ti.f32, records: ti.template(),
    maps: ti.template(), rule: Rule, exact: ti.template(), sums: ti.template(),
):  # fmt: skip
    """Add the gradient of a sample to its coefficients."""
    i, j, down, right = place_of(maps, at)
    group = plane // rule.shared
    for k in range(maps.shape[3]):
        side = side_of(path, disparity, rule.reach, k // 3)
        value = records[plane, ray, 4] * side * records[plane, ray, k % 3]
        add(sums[group, i, j, k], (1.0 - down) * (1.0 - right) * value, exact)
        add(sums[group, i, j + 1, k], (1.0 - down) * right * value, exact)
        add(sums[group, i + 1, j, k], down * (1.0 - right) * value, exact)
        add(sums[group, i + 1, j + 1, k], down * right * value, exact)


@ti.kernel
def _scatter_shine(
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
    active: i32_1,  # (1,)
    planes: f32_1,  # (16 + D,)
    height: ti.i32,
    width: ti.i32,
    records: f32_3,  # (D, R, 5)
    maps: f32_4,  # (G, h, w, 3 N)
    rule: Rule,
    threads: ti.i32,
    exact: ti.template(),
    # outputs
    sums: ti.types.ndarray(ndim=4),  # (G, h, w, 3 N), int64 if exact: added to
):
    for group, thread in ti.ndrange(maps.shape[0], threads):
        rays = ti.min(active[0], origins.shape[0])
        last = ti.min((group + 1) * rule.shared, planes.shape[0] - PLANES_PLACE)
        for plane in range(group * rule.shared, last):
            for turn in range((rays - thread + threads - 1) // threads):
                ray = thread + turn * threads
                if records[plane, ray, 4] > 0.0:
                    path = path_of(planes, origins, directions, ray)
                    q = planes[PLANES_PLACE + plane]
                    at = corner_of(path, q, height, width)
                    _scatter_side(path, plane, ray, at, q, records, maps, rule, exact, sums)


@primitive
def render_backward(
    d_seen: codes.Seen,
    rays: codes.Rays,
    planes: np.ndarray,
    texels: np.ndarray,
    shine: codes.Shine | None,
    stop: float,
    seen: codes.Seen,
    d_texels: np.ndarray,
    d_maps: np.ndarray | None,
) -> None:
    """Add the gradients of the texels to `d_texels` (D, H, W, 4).

    `d_seen` are gradients by the results of :func:`render` for the same rays, `texels` in float32,
    and `seen`. The end of a ray is treated as constant. With a `shine`, add the gradients of its
    maps to `d_maps`, of the same shape. On CUDA these two may be int64, for fixed-point numbers,
    whose sums do not depend on the order.
    """
    count, number = rays.origins.shape[0], texels.shape[0]
    records = scratch((number, count, 5), np.float32)
    totals, given = scratch((count,), np.float32), _given(shine, stop)
    total(*d_seen, rays.active, *seen, totals)
    _trace(*d_seen, *rays, planes, texels, *given, totals, records)
    threads = 1 if on_cpu() else count
    exact = d_texels.dtype == np.int64
    _scatter(*rays, planes, records, threads, exact, d_texels)
    if shine is not None and d_maps is not None:
        height, width = texels.shape[1:3]
        _scatter_shine(*rays, planes, height, width, records, *given, threads, exact, d_maps)
