"""Images of lit surfaces, and the gradients of that, in Taichi.

A matt surface of albedo rho and normal n shows ``rho max(0, l . n)`` under the light l, a vector
towards the light as long as it is strong [Lambert 1760]. A sky of harmonics up to degree 2 shows
``rho sum_c L_c b_c(n)``, where b has 1, y, z, x, x y, y z, 3 z^2 - 1, x z and x^2 - y^2 of the
normal, and L the constants of the harmonics and of the clamped cosine [Ramamoorthi and Hanrahan
2001].

Depth d grows away from the camera, in pixels, so that the normal (x right, y up, z towards the
camera) is ``(d_x, -d_y, 1) / sqrt(d_x^2 + d_y^2 + 1)``, with the rows' axis y downwards in d_y.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.shading import SHADOW_BIAS
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient, root

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)
vec9 = ti.types.vector(9, ti.f32)


@ti.func
def _finite(x: ti.f32) -> ti.i32:
    """Tell whether a number is neither NaN nor infinite, by its bits."""
    return ti.cast((ti.bit_cast(x, ti.i32) & 0x7F800000) != 0x7F800000, ti.i32)


@ti.func
def _slope(before: ti.f32, here: ti.f32, after: ti.f32) -> ti.f32:
    """Return the difference across a pixel: central, one-sided beside NaN or infinity, or 0."""
    slope = 0.0
    if _finite(before) and _finite(after):
        slope = (after - before) * 0.5
    elif _finite(after):
        slope = after - here
    elif _finite(before):
        slope = here - before
    return slope


@ti.func
def _at(depth: ti.template(), y: ti.i32, x: ti.i32) -> ti.f32:
    """Return a depth, or NaN outside of the image."""
    found = ti.cast(ti.math.nan, ti.f32)
    if 0 <= y < depth.shape[0] and 0 <= x < depth.shape[1]:
        found = depth[y, x]
    return found


@ti.func
def _slopes_at(depth: ti.template(), y: ti.i32, x: ti.i32):
    """Return the slopes of depth along the columns and down the rows."""
    here = depth[y, x]
    a = _slope(_at(depth, y, x - 1), here, _at(depth, y, x + 1))
    b = _slope(_at(depth, y - 1, x), here, _at(depth, y + 1, x))
    return ti.math.vec2(a, b)


@ti.kernel
def _normals(depth: f32_2, zero: ti.i32, out: f32_3):
    for y, x in depth:
        if _finite(depth[y, x]):
            s = _slopes_at(depth, y, x)
            length = root(product(s[0], s[0], zero) + product(s[1], s[1], zero) + 1.0, zero)
            out[y, x, 0] = quotient(s[0], length, zero)
            out[y, x, 1] = quotient(0.0 - s[1], length, zero)
            out[y, x, 2] = quotient(1.0, length, zero)
        else:
            for c in range(3):
                out[y, x, c] = ti.cast(ti.math.nan, ti.f32)


@primitive
def normals(depth: np.ndarray, out: np.ndarray) -> None:
    """Write the unit normals of a depth map, NaN where it is not finite."""
    _normals(depth, 0, out)


@ti.kernel
def _slope_gradients(depth: f32_2, grads: f32_3, zero: ti.i32, slopes: f32_3):
    for y, x in depth:
        a = 0.0
        b = 0.0
        if _finite(depth[y, x]):
            s = _slopes_at(depth, y, x)
            length = root(product(s[0], s[0], zero) + product(s[1], s[1], zero) + 1.0, zero)
            g0 = grads[y, x, 0]
            g1 = -grads[y, x, 1]
            g2 = grads[y, x, 2]
            dot = product(g0, s[0], zero) + product(g1, s[1], zero) + g2
            along = quotient(dot, product(length, length, zero), zero)
            a = quotient(g0 - product(along, s[0], zero), length, zero)
            b = quotient(g1 - product(along, s[1], zero), length, zero)
        slopes[y, x, 0] = a
        slopes[y, x, 1] = b


@primitive
def slope_gradients(depth: np.ndarray, grads: np.ndarray, slopes: np.ndarray) -> None:
    """Write gradients by the slopes of depth (H, W, 2), from those by normals."""
    _slope_gradients(depth, grads, 0, slopes)


@ti.func
def _share(before: ti.f32, after: ti.f32, side: ti.i32) -> ti.f32:
    """Return the weight in a slope of the pixel before (-1), the pixel itself (0) or after (1)."""
    share = 0.0
    if _finite(before) and _finite(after):
        share = 0.5 * side
    elif _finite(after):
        if side == 1:
            share = 1.0
        elif side == 0:
            share = -1.0
    elif _finite(before):
        if side == 0:
            share = 1.0
        elif side == -1:
            share = -1.0
    return share


@ti.kernel
def _depth_gradients(depth: f32_2, slopes: f32_3, zero: ti.i32, grads: f32_2):
    for y, x in depth:
        total = 0.0
        if _finite(depth[y, x]):
            for k in range(-1, 2):
                # The pixel at distance k has this one at its side -k.
                if _finite(_at(depth, y, x + k)):
                    share = _share(_at(depth, y, x + k - 1), _at(depth, y, x + k + 1), -k)
                    total += product(share, slopes[y, x + k, 0], zero)
                if _finite(_at(depth, y + k, x)):
                    share = _share(_at(depth, y + k - 1, x), _at(depth, y + k + 1, x), -k)
                    total += product(share, slopes[y + k, x, 1], zero)
        grads[y, x] = total


@primitive
def depth_gradients(depth: np.ndarray, slopes: np.ndarray, grads: np.ndarray) -> None:
    """Write gradients by depth, from those by its slopes."""
    _depth_gradients(depth, slopes, 0, grads)


@ti.func
def _basis(x: ti.f32, y: ti.f32, z: ti.f32, harmonic: ti.i32, zero: ti.i32):
    """Return the factors of the coefficients of a light."""
    b = vec9(0.0)
    if harmonic:
        b[0] = 1.0
        b[1] = y
        b[2] = z
        b[3] = x
        b[4] = product(x, y, zero)
        b[5] = product(y, z, zero)
        b[6] = product(product(3.0, z, zero), z, zero) - 1.0
        b[7] = product(x, z, zero)
        b[8] = product(x, x, zero) - product(y, y, zero)
    else:
        b[0] = x
        b[1] = y
        b[2] = z
    return b


@ti.func
def _light(lights: ti.template(), k: ti.i32, b: vec9, zero: ti.i32) -> ti.f32:
    """Return the light on a surface whose basis is `b`, from below the horizon too."""
    e = 0.0
    for c in ti.static(range(9)):
        if c < lights.shape[1]:
            e += product(lights[k, c], b[c], zero)
    return e


@ti.func
def _is_off(
    e: ti.f32, lit: ti.template(), attached: ti.i32, k: ti.i32, y: ti.i32, x: ti.i32
) -> ti.i32:
    """Tell whether a light does not reach a pixel."""
    off = (attached and e < 0.0) or not _finite(e)
    if lit.shape[0] > 0:
        off = off or lit[k, y, x] == ti.cast(0, ti.u8)
    return ti.cast(off, ti.i32)


@ti.kernel
def _shade(
    surface: f32_3,  # normals
    lights: f32_2,  # (K, 3) or (K, 9)
    albedo: f32_2,
    lit: u8_3,  # (K, H, W), or empty
    attached: ti.i32,
    zero: ti.i32,
    # outputs
    images: f32_3,
):
    harmonic = lights.shape[1] == 9
    for y, x in albedo:
        b = _basis(surface[y, x, 0], surface[y, x, 1], surface[y, x, 2], harmonic, zero)
        for k in range(lights.shape[0]):
            e = _light(lights, k, b, zero)
            if _is_off(e, lit, attached, k, y, x):
                e = 0.0
            images[k, y, x] = product(albedo[y, x], e, zero)


@primitive
def shade(
    surface: np.ndarray,
    lights: np.ndarray,
    albedo: np.ndarray,
    lit: np.ndarray,
    attached: bool,
    images: np.ndarray,
) -> None:
    """Write an image for each light; pixels without a normal are 0."""
    _shade(surface, lights, albedo, lit, attached, 0, images)


@ti.kernel
def _shade_gradients(
    grads: f32_3,  # by the images
    surface: f32_3,
    lights: f32_2,
    albedo: f32_2,
    lit: u8_3,
    attached: ti.i32,
    zero: ti.i32,
    # outputs
    by_surface: f32_3,
    by_albedo: f32_2,
):
    harmonic = lights.shape[1] == 9
    for y, x in albedo:
        nx = surface[y, x, 0]
        ny = surface[y, x, 1]
        nz = surface[y, x, 2]
        b = _basis(nx, ny, nz, harmonic, zero)
        back = vec9(0.0)
        total = 0.0
        for k in range(lights.shape[0]):
            e = _light(lights, k, b, zero)
            if not _is_off(e, lit, attached, k, y, x):
                g = grads[k, y, x]
                total += product(g, e, zero)
                for c in ti.static(range(9)):
                    if c < lights.shape[1]:
                        back[c] += product(g, lights[k, c], zero)
        gx = back[0]
        gy = back[1]
        gz = back[2]
        if harmonic:
            gx = back[3] + product(back[4], ny, zero) + product(back[7], nz, zero)
            gx += product(2.0 * back[8], nx, zero)
            gy = back[1] + product(back[4], nx, zero) + product(back[5], nz, zero)
            gy -= product(2.0 * back[8], ny, zero)
            gz = back[2] + product(back[5], ny, zero)
            gz += product(product(6.0, back[6], zero), nz, zero)
            gz += product(back[7], nx, zero)
        if _finite(nx + ny + nz):
            by_surface[y, x, 0] = product(albedo[y, x], gx, zero)
            by_surface[y, x, 1] = product(albedo[y, x], gy, zero)
            by_surface[y, x, 2] = product(albedo[y, x], gz, zero)
        else:
            for c in range(3):
                by_surface[y, x, c] = 0.0
        by_albedo[y, x] = total


@primitive
def shade_gradients(
    grads: np.ndarray,
    surface: np.ndarray,
    lights: np.ndarray,
    albedo: np.ndarray,
    lit: np.ndarray,
    attached: bool,
    by_surface: np.ndarray,
    by_albedo: np.ndarray,
) -> None:
    """Write the gradients by normals and by albedo."""
    _shade_gradients(grads, surface, lights, albedo, lit, attached, 0, by_surface, by_albedo)


@ti.kernel
def _light_gradients(
    grads: f32_3,
    surface: f32_3,
    lights: f32_2,
    albedo: f32_2,
    lit: u8_3,
    attached: ti.i32,
    zero: ti.i32,
    # outputs
    rows: f64_3,
):
    harmonic = lights.shape[1] == 9
    for y, k in ti.ndrange(rows.shape[0], rows.shape[1]):
        for c in range(lights.shape[1]):
            rows[y, k, c] = ti.cast(0.0, ti.f64)
        for x in range(albedo.shape[1]):
            b = _basis(surface[y, x, 0], surface[y, x, 1], surface[y, x, 2], harmonic, zero)
            e = _light(lights, k, b, zero)
            if not _is_off(e, lit, attached, k, y, x):
                g = product(grads[k, y, x], albedo[y, x], zero)
                for c in ti.static(range(9)):
                    if c < lights.shape[1]:
                        rows[y, k, c] += ti.cast(product(g, b[c], zero), ti.f64)


@primitive
def light_gradients(
    grads: np.ndarray,
    surface: np.ndarray,
    lights: np.ndarray,
    albedo: np.ndarray,
    lit: np.ndarray,
    attached: bool,
    rows: np.ndarray,
) -> None:
    """Write each row's part of the gradients by the lights, (H, K, C) float64, left to right."""
    _light_gradients(grads, surface, lights, albedo, lit, attached, 0, rows)


@ti.kernel
def _cast(depth: f32_2, lights: f32_2, top: ti.f32, zero: ti.i32, lit: u8_3):
    height = depth.shape[0]
    width = depth.shape[1]
    for k, y, x in lit:
        major = ti.max(ti.abs(lights[k, 0]), ti.abs(lights[k, 1]))
        free = 1
        ray = depth[y, x]
        if major > 0.0 and _finite(ray):
            across = quotient(lights[k, 0], major, zero)
            down = quotient(-lights[k, 1], major, zero)
            rise = quotient(lights[k, 2], major, zero)
            s = 1.0
            inside = 1
            while inside and free:
                u = ti.cast(x, ti.f32) + product(s, across, zero)
                v = ti.cast(y, ti.f32) + product(s, down, zero)
                z = ray - product(s, rise, zero)
                left = ti.cast(ti.floor(u), ti.i32)
                above = ti.cast(ti.floor(v), ti.i32)
                if left < 0 or above < 0 or left >= width or above >= height:
                    inside = 0
                elif rise > 0.0 and z < top:
                    inside = 0
                else:
                    # One of the two lies on whole pixels: interpolate along the other.
                    a = u - ti.cast(left, ti.f32)
                    b = v - ti.cast(above, ti.f32)
                    here = depth[above, left]
                    there = here
                    share = a
                    if a > 0.0 and left + 1 < width:
                        there = depth[above, left + 1]
                    elif b > 0.0 and above + 1 < height:
                        there = depth[above + 1, left]
                        share = b
                    seen = here + product(share, there - here, zero)
                    if seen < z - ti.cast(SHADOW_BIAS, ti.f32):
                        free = 0
                    s += 1.0
        lit[k, y, x] = ti.cast(free, ti.u8)


@primitive
def cast(depth: np.ndarray, lights: np.ndarray, top: float, lit: np.ndarray) -> None:
    """Mark the pixels that each light reaches; `top` is the least depth of the map."""
    _cast(depth, lights, top, 0, lit)
