"""Images of lit surfaces, and the gradients of that, in Warp.

The Taichi set has the equations; here one thread has a pixel, on the CPU in slabs.
"""

import warp as wp

from cvkern.kernels.codes.shading import SHADOW_BIAS
from cvkern.kernels.warp._launch import launch_each

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

BIAS = wp.constant(SHADOW_BIAS)
vec9 = wp.types.vector(length=9, dtype=wp.float32)


@wp.func
def _slope(before: float, here: float, after: float):
    """Return the difference across a pixel: central, one-sided beside NaN or infinity, or 0."""
    slope = float(0.0)
    if wp.isfinite(before) and wp.isfinite(after):
        slope = (after - before) * 0.5
    elif wp.isfinite(after):
        slope = after - here
    elif wp.isfinite(before):
        slope = here - before
    return slope


@wp.func
def _at(depth: wp.array2d[float], y: int, x: int):
    """Return a depth, or NaN outside of the image."""
    if y < 0 or x < 0 or y >= depth.shape[0] or x >= depth.shape[1]:
        return wp.nan
    return depth[y, x]


@wp.func
def _slopes_at(depth: wp.array2d[float], y: int, x: int):
    """Return the slopes of depth along the columns and down the rows."""
    here = depth[y, x]
    a = _slope(_at(depth, y, x - 1), here, _at(depth, y, x + 1))
    b = _slope(_at(depth, y - 1, x), here, _at(depth, y + 1, x))
    return wp.vec2(a, b)


def normals(depth: wp.array, out: wp.array) -> None:
    """Write the unit normals of a depth map, NaN where it is not finite."""
    launch_each(_normals, depth.size, 8 * depth.size, [depth], [out])


@wp.kernel
def _normals(
    stride: int,
    first: int,
    last: int,
    depth: wp.array2d[float],
    # outputs
    out: wp.array3d[float],
):
    for i in range(first + wp.tid(), last, stride):
        y = i // depth.shape[1]
        x = i % depth.shape[1]
        if wp.isfinite(depth[y, x]):
            s = _slopes_at(depth, y, x)
            length = wp.sqrt(s[0] * s[0] + s[1] * s[1] + 1.0)
            out[y, x, 0] = s[0] / length
            out[y, x, 1] = (0.0 - s[1]) / length
            out[y, x, 2] = 1.0 / length
        else:
            for c in range(3):
                out[y, x, c] = wp.nan


def slope_gradients(depth: wp.array, grads: wp.array, slopes: wp.array) -> None:
    """Write gradients by the slopes of depth (H, W, 2), from those by normals."""
    launch_each(_slope_gradients, depth.size, 16 * depth.size, [depth, grads], [slopes])


@wp.kernel
def _slope_gradients(
    stride: int,
    first: int,
    last: int,
    depth: wp.array2d[float],
    grads: wp.array3d[float],
    # outputs
    slopes: wp.array3d[float],
):
    for i in range(first + wp.tid(), last, stride):
        y = i // depth.shape[1]
        x = i % depth.shape[1]
        a = float(0.0)
        b = float(0.0)
        if wp.isfinite(depth[y, x]):
            s = _slopes_at(depth, y, x)
            length = wp.sqrt(s[0] * s[0] + s[1] * s[1] + 1.0)
            g0 = grads[y, x, 0]
            g1 = -grads[y, x, 1]
            g2 = grads[y, x, 2]
            along = (g0 * s[0] + g1 * s[1] + g2) / (length * length)
            a = (g0 - along * s[0]) / length
            b = (g1 - along * s[1]) / length
        slopes[y, x, 0] = a
        slopes[y, x, 1] = b


@wp.func
def _share(before: float, after: float, side: int):
    """Return the weight in a slope of the pixel before (-1), the pixel itself (0) or after (1)."""
    share = float(0.0)
    if wp.isfinite(before) and wp.isfinite(after):
        share = 0.5 * float(side)
    elif wp.isfinite(after):
        share = wp.where(side == 1, 1.0, wp.where(side == 0, -1.0, 0.0))
    elif wp.isfinite(before):
        share = wp.where(side == 0, 1.0, wp.where(side == -1, -1.0, 0.0))
    return share


def depth_gradients(depth: wp.array, slopes: wp.array, grads: wp.array) -> None:
    """Write gradients by depth, from those by its slopes."""
    launch_each(_depth_gradients, depth.size, 24 * depth.size, [depth, slopes], [grads])


@wp.kernel
def _depth_gradients(
    stride: int,
    first: int,
    last: int,
    depth: wp.array2d[float],
    slopes: wp.array3d[float],
    # outputs
    grads: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        y = i // depth.shape[1]
        x = i % depth.shape[1]
        total = float(0.0)
        if wp.isfinite(depth[y, x]):
            for k in range(-1, 2):
                # The pixel at distance k has this one at its side -k.
                if wp.isfinite(_at(depth, y, x + k)):
                    share = _share(_at(depth, y, x + k - 1), _at(depth, y, x + k + 1), -k)
                    total += share * slopes[y, x + k, 0]
                if wp.isfinite(_at(depth, y + k, x)):
                    share = _share(_at(depth, y + k - 1, x), _at(depth, y + k + 1, x), -k)
                    total += share * slopes[y + k, x, 1]
        grads[y, x] = total


@wp.func
def _basis(x: float, y: float, z: float, harmonic: bool):
    """Return the factors of the coefficients of a light."""
    b = vec9()
    if harmonic:
        b[0] = 1.0
        b[1] = y
        b[2] = z
        b[3] = x
        b[4] = x * y
        b[5] = y * z
        b[6] = 3.0 * z * z - 1.0
        b[7] = x * z
        b[8] = x * x - y * y
    else:
        b[0] = x
        b[1] = y
        b[2] = z
    return b


@wp.func
def _light(lights: wp.array2d[float], k: int, b: vec9):
    """Return the light on a surface whose basis is `b`, from below the horizon too."""
    e = float(0.0)
    for c in range(lights.shape[1]):
        e += lights[k, c] * b[c]
    return e


@wp.func
def _is_off(e: float, lit: wp.array3d[wp.uint8], attached: bool, k: int, y: int, x: int):
    """Tell whether a light does not reach a pixel."""
    off = (attached and e < 0.0) or not wp.isfinite(e)
    if lit.shape[0] > 0:
        off = off or lit[k, y, x] == wp.uint8(0)
    return off


def shade(
    surface: wp.array,
    lights: wp.array,
    albedo: wp.array,
    lit: wp.array,
    attached: bool,
    images: wp.array,
) -> None:
    """Write an image for each light; pixels without a normal are 0."""
    inputs = [surface, lights, albedo, lit, attached]
    size = images.shape[1] * images.shape[2]
    launch_each(_shade, size, 4 * images.size, inputs, [images])


@wp.kernel
def _shade(
    stride: int,
    first: int,
    last: int,
    surface: wp.array3d[float],  # normals
    lights: wp.array2d[float],  # (K, 3) or (K, 9)
    albedo: wp.array2d[float],
    lit: wp.array3d[wp.uint8],  # (K, H, W), or empty
    attached: bool,
    # outputs
    images: wp.array3d[float],
):
    width = images.shape[2]
    for i in range(first + wp.tid(), last, stride):
        y = i // width
        x = i % width
        b = _basis(surface[y, x, 0], surface[y, x, 1], surface[y, x, 2], lights.shape[1] == 9)
        for k in range(lights.shape[0]):
            e = _light(lights, k, b)
            if _is_off(e, lit, attached, k, y, x):
                e = 0.0
            images[k, y, x] = albedo[y, x] * e


def shade_gradients(
    grads: wp.array,
    surface: wp.array,
    lights: wp.array,
    albedo: wp.array,
    lit: wp.array,
    attached: bool,
    by_surface: wp.array,
    by_albedo: wp.array,
) -> None:
    """Write the gradients by normals and by albedo."""
    inputs = [grads, surface, lights, albedo, lit, attached]
    launch_each(_shade_gradients, albedo.size, 8 * grads.size, inputs, [by_surface, by_albedo])


@wp.kernel
def _shade_gradients(
    stride: int,
    first: int,
    last: int,
    grads: wp.array3d[float],  # by the images
    surface: wp.array3d[float],
    lights: wp.array2d[float],
    albedo: wp.array2d[float],
    lit: wp.array3d[wp.uint8],
    attached: bool,
    # outputs
    by_surface: wp.array3d[float],
    by_albedo: wp.array2d[float],
):
    width = albedo.shape[1]
    for i in range(first + wp.tid(), last, stride):
        y = i // width
        x = i % width
        nx = surface[y, x, 0]
        ny = surface[y, x, 1]
        nz = surface[y, x, 2]
        b = _basis(nx, ny, nz, lights.shape[1] == 9)
        back = vec9()
        total = float(0.0)
        for k in range(lights.shape[0]):
            e = _light(lights, k, b)
            if not _is_off(e, lit, attached, k, y, x):
                g = grads[k, y, x]
                total += g * e
                for c in range(lights.shape[1]):
                    back[c] += g * lights[k, c]
        gx = back[0]
        gy = back[1]
        gz = back[2]
        if lights.shape[1] == 9:
            gx = back[3] + back[4] * ny + back[7] * nz + 2.0 * back[8] * nx
            gy = back[1] + back[4] * nx + back[5] * nz - 2.0 * back[8] * ny
            gz = back[2] + back[5] * ny + 6.0 * back[6] * nz + back[7] * nx
        if wp.isfinite(nx + ny + nz):
            by_surface[y, x, 0] = albedo[y, x] * gx
            by_surface[y, x, 1] = albedo[y, x] * gy
            by_surface[y, x, 2] = albedo[y, x] * gz
        else:
            for c in range(3):
                by_surface[y, x, c] = 0.0
        by_albedo[y, x] = total


def light_gradients(
    grads: wp.array,
    surface: wp.array,
    lights: wp.array,
    albedo: wp.array,
    lit: wp.array,
    attached: bool,
    rows: wp.array,
) -> None:
    """Write each row's part of the gradients by the lights, (H, K, C) float64, left to right."""
    inputs = [grads, surface, lights, albedo, lit, attached]
    count = rows.shape[0] * rows.shape[1]
    launch_each(_light_gradients, count, 8 * grads.size, inputs, [rows])


@wp.kernel
def _light_gradients(
    stride: int,
    first: int,
    last: int,
    grads: wp.array3d[float],
    surface: wp.array3d[float],
    lights: wp.array2d[float],
    albedo: wp.array2d[float],
    lit: wp.array3d[wp.uint8],
    attached: bool,
    # outputs
    rows: wp.array3d[wp.float64],
):
    for i in range(first + wp.tid(), last, stride):
        y = i // lights.shape[0]
        k = i % lights.shape[0]
        for c in range(lights.shape[1]):
            rows[y, k, c] = wp.float64(0.0)
        for x in range(albedo.shape[1]):
            b = _basis(surface[y, x, 0], surface[y, x, 1], surface[y, x, 2], lights.shape[1] == 9)
            e = _light(lights, k, b)
            if not _is_off(e, lit, attached, k, y, x):
                g = grads[k, y, x] * albedo[y, x]
                for c in range(lights.shape[1]):
                    rows[y, k, c] += wp.float64(g * b[c])


def cast(depth: wp.array, lights: wp.array, top: float, lit: wp.array) -> None:
    """Mark the pixels that each light reaches; `top` is the least depth of the map."""
    launch_each(_cast, lit.size, 64 * lit.size, [depth, lights, top], [lit])


@wp.kernel
def _cast(
    stride: int,
    first: int,
    last: int,
    depth: wp.array2d[float],
    lights: wp.array2d[float],  # (K, 3)
    top: float,
    # outputs
    lit: wp.array3d[wp.uint8],
):
    height = depth.shape[0]
    width = depth.shape[1]
    for i in range(first + wp.tid(), last, stride):
        k = i // (height * width)
        y = i // width % height
        x = i % width
        major = wp.max(wp.abs(lights[k, 0]), wp.abs(lights[k, 1]))
        free = wp.uint8(1)
        ray = depth[y, x]
        if major > 0.0 and wp.isfinite(ray):
            across = lights[k, 0] / major
            down = -lights[k, 1] / major
            rise = lights[k, 2] / major
            s = float(1.0)
            while free == wp.uint8(1):
                u = float(x) + s * across
                v = float(y) + s * down
                z = ray - s * rise
                left = int(wp.floor(u))
                above = int(wp.floor(v))
                if (
                    left < 0 or above < 0 or left >= width or above >= height
                    or (rise > 0.0 and z < top)
                ):  # fmt: skip
                    break
                # One of the two lies on whole pixels: interpolate along the other.
                a = u - float(left)
                b = v - float(above)
                here = depth[above, left]
                there = here
                share = a
                if a > 0.0 and left + 1 < width:
                    there = depth[above, left + 1]
                elif b > 0.0 and above + 1 < height:
                    there = depth[above + 1, left]
                    share = b
                seen = here + share * (there - here)
                if seen < z - BIAS:
                    free = wp.uint8(0)
                s += 1.0
        lit[k, y, x] = free
