"""Normals and albedo of pixels seen under several lights, in Taichi: one thread a pixel.

A matt pixel shows ``i_k = l_k . s`` with ``s = rho n``. Weighted least squares are
``s = A^-1 b``, ``A = sum w_k l_k l_k^T``, ``b = sum w_k i_k l_k`` [Woodham 1980]. The rules differ
in the weights w:

- trimmed: 1 for the images whose rank among those of the pixel lies in a window;
- L1: ``1 / |i_k - l_k . s|``, again and again;
- sparse Bayes: noise of a variance g_k of its own for each image, most of them 0, so that
  ``w_k = 1 / (g_k + noise)`` [Ikehata et al. 2012]. With ``d = w_k`` and ``h = l_k^T A^-1 l_k``,
  the variance becomes ``(g d r)^2 + g - g^2 d (1 - d h)``, where r is the residual;
- consensus: several windows of ranks, in each the weights of Cauchy's distribution,
  ``1 / (1 + (r / spread)^2)``, and 0 where the model is dark. The normals of the windows are
  averaged, each with the inverse of its standard deviation as its weight: ``spread sqrt(t) / |s|``
  with the trace t of A^-1 across s. So a window that leaves too little to tell the normal counts
  little, and so does one with outliers.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes import shading as codes
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._rounding import product, quotient, root
from cvkern.kernels.taichi.shading._mask import is_inside

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
u16_3 = ti.types.ndarray(dtype=ti.u16, ndim=3)
vec3 = ti.types.vector(3, ti.f64)
mat3 = ti.types.matrix(3, 3, ti.f64)

LEFT_OUT = codes.LEFT_OUT
L1, BAYES, CONSENSUS = (
    int(code)
    for code in (
        codes.Photometric.L1, codes.Photometric.SPARSE_BAYES, codes.Photometric.CONSENSUS,
    )
)  # fmt: skip


@ti.func
def _finite(x: ti.f32) -> ti.i32:
    """Tell whether a number is neither NaN nor infinite, by its bits."""
    return ti.cast((ti.bit_cast(x, ti.i32) & 0x7F800000) != 0x7F800000, ti.i32)


@ti.func
def _give_up(
    normals: ti.template(), albedo: ti.template(), residual: ti.template(), y: ti.i32, x: ti.i32
):
    """Write NaN for the normal of a pixel that has none, and 0 for the rest."""
    for j in range(3):
        normals[y, x, j] = ti.cast(ti.math.nan, ti.f32)
    albedo[y, x] = 0.0
    residual[y, x] = 0.0


@ti.kernel
def _solve(
    images: f32_3,  # (K, H, W)
    inverse: f32_2,  # (3, K)
    lights: f32_2,  # (K, 4)
    mask: u8_2,
    zero: ti.i32,
    # outputs
    normals: f32_3,
    albedo: f32_2,
    residual: f32_2,
):
    for y, x in albedo:
        a = 0.0
        b = 0.0
        c = 0.0
        for k in range(images.shape[0]):
            value = images[k, y, x]
            a += product(inverse[0, k], value, zero)
            b += product(inverse[1, k], value, zero)
            c += product(inverse[2, k], value, zero)
        total = 0.0
        for k in range(images.shape[0]):
            e = product(lights[k, 0], a, zero) + product(lights[k, 1], b, zero)
            e += product(lights[k, 2], c, zero)
            off = images[k, y, x]
            if e > 0.0:
                off -= e
            total += product(off, off, zero)
        length = root(product(a, a, zero) + product(b, b, zero) + product(c, c, zero), zero)
        if is_inside(mask, y, x) and length > 0.0 and _finite(length):
            normals[y, x, 0] = quotient(a, length, zero)
            normals[y, x, 1] = quotient(b, length, zero)
            normals[y, x, 2] = quotient(c, length, zero)
            albedo[y, x] = length
            mean = quotient(total, ti.cast(images.shape[0], ti.f32), zero)
            residual[y, x] = root(mean, zero)
        else:
            _give_up(normals, albedo, residual, y, x)


@primitive
def solve(
    images: np.ndarray,
    inverse: np.ndarray,
    lights: np.ndarray,
    mask: np.ndarray,
    normals: np.ndarray,
    albedo: np.ndarray,
    residual: np.ndarray,
) -> None:
    """Write the least-squares solution over all images: the inverse (3, K) times each pixel."""
    _solve(images, inverse, lights, mask, 0, normals, albedo, residual)


@ti.kernel
def _rank(images: f32_3, scales: f32_1, mask: u8_2, limit: ti.f32, ranks: u16_3):
    for y, x in ti.ndrange(images.shape[1], images.shape[2]):
        for k in range(images.shape[0]):
            value = images[k, y, x]
            below = LEFT_OUT
            if is_inside(mask, y, x) and _finite(value) and value < limit:
                below = 0
                value *= scales[k]
                for j in range(images.shape[0]):
                    given = images[j, y, x]
                    other = given * scales[j]
                    if _finite(given) and given < limit:
                        if other < value or (other == value and j < k):
                            below += 1
            ranks[k, y, x] = ti.cast(below, ti.u16)


@primitive
def rank(
    images: np.ndarray, scales: np.ndarray, mask: np.ndarray, limit: float, ranks: np.ndarray
) -> None:
    """Write how many images show a pixel darker; of equal ones the earlier is the darker.

    Images are compared after multiplication by their scales (K,). What is not finite, or `limit` or
    above, or outside of the mask, is left out.
    """
    _rank(images, scales, mask, limit, ranks)


@ti.func
def _light(lights: ti.template(), depth: ti.template(), k: ti.i32, y: ti.i32, x: ti.i32) -> vec3:
    """Return the light that reaches a pixel: the same everywhere, or from a place nearby."""
    light = vec3(0.0)
    for c in ti.static(range(3)):
        light[c] = ti.cast(lights[k, c], ti.f64)
    if depth.shape[0] > 0:
        light[0] -= ti.cast(x, ti.f64)
        light[1] += ti.cast(y, ti.f64)
        light[2] += ti.cast(depth[y, x], ti.f64)
        length = ti.sqrt(light.dot(light))
        light *= ti.cast(lights[k, 3], ti.f64) / (length * length * length)
    return light


@ti.func
def _value(images: ti.template(), lights: ti.template(), k: ti.i32, y: ti.i32, x: ti.i32) -> ti.f64:
    """Return the value of an image, times the scale of its light."""
    return ti.cast(images[k, y, x], ti.f64) * ti.cast(lights[k, 4], ti.f64)


@ti.func
def _weight(value: ti.f64, shown: ti.f64, spread: ti.f64, method: ti.i32) -> ti.f64:
    """Return the weight of an image whose model shows `shown`, where residuals spread so far."""
    off = ti.abs(value - shown)
    weight = ti.cast(1.0, ti.f64)
    if spread > 0.0:
        if method == L1:
            weight = 1.0 / ti.max(off / spread, ti.f64(1e-3))
        elif method == CONSENSUS:
            weight = 1.0 / (1.0 + (off / spread) * (off / spread))
            if shown <= 0.0:
                weight = 0.0
            weight += ti.f64(codes.FLOOR)
    return weight


@ti.func
def _takes_part(rank: ti.i32, low: ti.i32, high: ti.i32, value: ti.f32, lit: ti.i32) -> ti.i32:
    """Tell whether an image takes part in a window, of those that are `lit` or of all."""
    part = low <= rank < high and (not lit or value > 0.0)
    return ti.cast(part, ti.i32)


@ti.kernel
def _weigh(
    images: f32_3,
    ranks: u16_3,
    lights: f32_2,
    depth: f32_2,
    windows: f32_2,  # (M, 2): from and to, as shares of the ranks
    method: ti.i32,
    sweeps: ti.i32,
    # outputs
    normals: f32_3,
    albedo: f32_2,
    residual: f32_2,
    variances: f32_3,
):
    for y, x in albedo:
        number = 0
        above = 0
        brightest = ti.cast(0.0, ti.f64)
        for k in range(images.shape[0]):
            if ranks[k, y, x] != LEFT_OUT:
                number += 1
                above += ti.cast(images[k, y, x] > 0.0, ti.i32)
                brightest = ti.max(brightest, _value(images, lights, k, y, x))
        # A consensus leaves dark images out, but fewer than three tell no normal.
        lit = ti.cast(method == CONSENSUS and above >= 3, ti.i32)
        mean = vec3(0.0)
        strength = ti.cast(0.0, ti.f64)
        total = ti.cast(0.0, ti.f64)
        found = number >= 3 and brightest > 0.0
        if depth.shape[0] > 0:
            found = found and _finite(depth[y, x])
        for m in range(windows.shape[0]):
            if not found:
                continue
            low = ti.cast(ti.floor(windows[m, 0] * number + 0.5), ti.i32)
            high = ti.cast(ti.floor(windows[m, 1] * number + 0.5), ti.i32)
            inside = 0
            for k in range(images.shape[0]):
                r = ti.cast(ranks[k, y, x], ti.i32)
                inside += _takes_part(r, low, high, images[k, y, x], lit)
            if inside < 4:  # too few to tell their spread
                low = 0
                high = number
            s = vec3(0.0)
            spread = ti.cast(0.0, ti.f64)
            turn = ti.cast(0.0, ti.f64)
            for sweep in range(sweeps + 1):
                a = mat3(0.0)
                b = vec3(0.0)
                for k in range(images.shape[0]):
                    r = ti.cast(ranks[k, y, x], ti.i32)
                    if _takes_part(r, low, high, images[k, y, x], lit):
                        value = _value(images, lights, k, y, x)
                        light = _light(lights, depth, k, y, x)
                        weight = ti.cast(1.0, ti.f64)
                        if method == BAYES:
                            if sweep == 0:
                                variances[k, y, x] = 1.0
                            g = ti.cast(variances[k, y, x], ti.f64)
                            weight = 1.0 / (g + ti.f64(codes.SPARSE_NOISE))
                        elif sweep > 0:
                            weight = _weight(value, light.dot(s), spread, method)
                        a += weight * light.outer_product(light)
                        b += (weight * value) * light
                ridge = ti.f64(codes.RIDGE) * a.trace()
                for j in ti.static(range(3)):
                    a[j, j] += ridge
                inverse = a.inverse()
                old = s
                s = inverse @ b
                squares = ti.cast(0.0, ti.f64)
                weights = ti.cast(0.0, ti.f64)
                for k in range(images.shape[0]):
                    r = ti.cast(ranks[k, y, x], ti.i32)
                    if _takes_part(r, low, high, images[k, y, x], lit):
                        value = _value(images, lights, k, y, x)
                        light = _light(lights, depth, k, y, x)
                        off = value - light.dot(s)
                        weight = ti.cast(1.0, ti.f64)
                        if method == BAYES:
                            g = ti.cast(variances[k, y, x], ti.f64)
                            d = 1.0 / (g + ti.f64(codes.SPARSE_NOISE))
                            lever = light.dot(inverse @ light)
                            e = g * d * off / brightest
                            g -= g * g * d * (1.0 - d * lever)
                            variances[k, y, x] = ti.cast(ti.max(e * e + g, 0.0), ti.f32)
                        elif sweep > 0:
                            weight = _weight(value, light.dot(old), spread, method)
                        squares += weight * off * off
                        weights += weight
                spread = ti.sqrt(squares / ti.max(weights - 3.0, ti.cast(0.5, ti.f64)))
                power = s.dot(s)
                if power > 0.0:
                    along = s.dot(inverse @ s) / power
                    turn = (inverse.trace() - along) / power
            length = ti.sqrt(s.dot(s))
            if 0.0 < length < ti.math.inf:
                share = ti.cast(1.0, ti.f64)
                if windows.shape[0] > 1:
                    tiny = ti.f64(1e-6)
                    share = 1.0 / (spread * ti.sqrt(ti.max(turn, 0.0)) + tiny)
                mean += (share / length) * s
                strength += share * length
                total += share
        length = ti.sqrt(mean.dot(mean))
        if found and length > 0.0:
            mean /= length
            strength /= total
            squares = ti.cast(0.0, ti.f64)
            for k in range(images.shape[0]):
                if ranks[k, y, x] != LEFT_OUT:
                    shown = strength * mean.dot(_light(lights, depth, k, y, x))
                    off = _value(images, lights, k, y, x) - ti.max(shown, 0.0)
                    off /= ti.cast(lights[k, 4], ti.f64)
                    squares += off * off
            for j in ti.static(range(3)):
                normals[y, x, j] = ti.cast(mean[j], ti.f32)
            albedo[y, x] = ti.cast(strength, ti.f32)
            residual[y, x] = ti.cast(ti.sqrt(squares / number), ti.f32)
        else:
            _give_up(normals, albedo, residual, y, x)


@primitive
def weigh(
    images: np.ndarray,
    ranks: np.ndarray,
    lights: np.ndarray,
    depth: np.ndarray,
    windows: np.ndarray,
    weighing: codes.Weighing,
    normals: np.ndarray,
    albedo: np.ndarray,
    residual: np.ndarray,
) -> None:
    """Write the solution of a robust rule, the mean of those of several windows of ranks.

    The lights (K, 5) are a vector or a position, the strength of a near light, and the scale of the
    image.
    """
    bayes = weighing.method == codes.Photometric.SPARSE_BAYES
    shape = tuple(images.shape) if bayes else (1, 1, 1)
    _weigh(
        images, ranks, lights, depth, windows, weighing.method, weighing.sweeps,
        normals, albedo, residual, scratch(shape, np.float32),
    )  # fmt: skip
