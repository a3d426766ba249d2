"""Poisson's equation in a rectangle by cosine transforms, in Taichi.

The equations of `equations` with all weights 1 have the matrix of the discrete Laplacian with free
borders. Cosines of whole numbers of half turns are its eigenvectors, and its eigenvalues are
``4 sin^2(pi k / 2H) + 4 sin^2(pi l / 2W)``. So the depth is the inverse transform of the transform
of the right side over the eigenvalues.

A cosine transform of N values is a Fourier transform of the same length [Makhoul 1980]: values of
even number come first, those of odd number follow in reverse order, and
``C_k = cos(pi k / 2N) Re V_k + sin(pi k / 2N) Im V_k``. Two real lines are transformed as the real
and the imaginary part of one. The Fourier transform has a stage for each factor of N [Stockham].
Complex arrays have a last axis of 2.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
vec2 = ti.math.vec2
vec4 = ti.math.vec4


@ti.func
def _place(n: ti.i32, count: ti.i32) -> ti.i32:
    """Return the place of value n in Makhoul's order."""
    place = n // 2
    if n % 2 == 1:
        place = count - 1 - n // 2
    return place


@ti.func
def _right_side(slope: ti.template(), y: ti.i32, x: ti.i32) -> ti.f32:
    """Return the sum of the rises of the edges that end in a pixel less those that begin there."""
    total = 0.0
    if x > 0:
        total += 0.5 * (slope[0, y, x - 1] + slope[0, y, x])
    if x + 1 < slope.shape[2]:
        total -= 0.5 * (slope[0, y, x] + slope[0, y, x + 1])
    if y > 0:
        total += 0.5 * (slope[1, y - 1, x] + slope[1, y, x])
    if y + 1 < slope.shape[1]:
        total -= 0.5 * (slope[1, y, x] + slope[1, y + 1, x])
    return total


@ti.kernel
def _begin(slope: f32_3, out: f32_3):
    for y, j in ti.ndrange(out.shape[0], out.shape[1]):
        v = _place(y, out.shape[0])
        for s in ti.static(range(2)):
            value = 0.0
            if 2 * j + s < slope.shape[2]:
                value = _right_side(slope, y, 2 * j + s)
            out[v, j, s] = value


@primitive
def begin(slope: np.ndarray, out: np.ndarray) -> None:
    """Step 1: write the right side from slopes (3, H, W).

    Rows are in Makhoul's order, and two columns are one complex column.
    """
    _begin(slope, out)


@ti.kernel
def _stage(
    src: f32_3, waves: f32_2, radix: ti.i32, before: ti.i32, axis: ti.i32, sign: ti.f32, out: f32_3
):
    count = waves.shape[0]
    for a, b in ti.ndrange(src.shape[0], src.shape[1]):
        n = b
        if axis == 0:
            n = a
        turn = n % (before * radix)
        first = n // (before * radix) * before + turn % before
        step = turn * (count // (before * radix))
        total = vec2(0.0)
        wave = 0
        for t in range(radix):
            at = first + t * (count // radix)
            z = vec2(0.0)
            if axis == 0:
                z = vec2(src[at, b, 0], src[at, b, 1])
            else:
                z = vec2(src[a, at, 0], src[a, at, 1])
            c = waves[wave, 0]
            s = sign * waves[wave, 1]
            total += vec2(c * z[0] - s * z[1], c * z[1] + s * z[0])
            wave += step
            if wave >= count:
                wave -= count
        out[a, b, 0] = total[0]
        out[a, b, 1] = total[1]


@primitive
def stage(
    src: np.ndarray,
    waves: np.ndarray,
    radix: int,
    before: int,
    axis: int,
    sign: float,
    out: np.ndarray,
) -> None:
    """Do steps 2, 4, 6 and 8: write a stage of Fourier transforms along axis 0 or 1.

    `before` is the product of the factors of earlier stages. The waves (N, 2) are
    ``cos(2 pi k / N)`` and ``sin(2 pi k / N)``; the sign is that of the exponent.
    """
    _stage(src, waves, radix, before, axis, sign, out)


@ti.func
def _apart(z: vec2, y: vec2):
    """Return the transforms of two real lines at k, from the complex one at k and N - k."""
    return vec4(z[0] + y[0], z[1] - y[1], z[1] + y[1], y[0] - z[0]) * 0.5


@ti.func
def _at(src: ti.template(), a: ti.i32, b: ti.i32):
    return vec2(src[a, b, 0], src[a, b, 1])


@ti.kernel
def _across(src: f32_3, quarters: f32_2, out: f32_3):
    height = src.shape[0]
    width = out.shape[1]
    for i, j in ti.ndrange(out.shape[0], src.shape[1]):
        for s in ti.static(range(2)):
            k = 2 * i + s
            even = 0.0
            odd = 0.0
            if k < height:
                v = _apart(_at(src, k, j), _at(src, (height - k) % height, j))
                even = quarters[k, 0] * v[0] + quarters[k, 1] * v[1]
                odd = quarters[k, 0] * v[2] + quarters[k, 1] * v[3]
            out[i, _place(2 * j, width), s] = even
            if 2 * j + 1 < width:
                out[i, _place(2 * j + 1, width), s] = odd


@primitive
def across(src: np.ndarray, quarters: np.ndarray, out: np.ndarray) -> None:
    """Step 3: finish the cosine transforms along columns.

    Columns are then in Makhoul's order, and two rows are one complex row.

    The quarters (H, 2) are ``cos(pi k / 2H)`` and ``sin(pi k / 2H)``.
    """
    _across(src, quarters, out)


@ti.func
def _share(down: ti.f32, along: ti.f32, size: ti.f32) -> ti.f32:
    """Return 1 over an eigenvalue times the number of pixels, or 0 for the mean."""
    share = 0.0
    if down + along > 0.0:
        share = 1.0 / (size * (down + along))
    return share


@ti.func
def _together(c: ti.f32, s: ti.f32, at: vec4):
    """Return a complex transform at k and N - k, from values of two real lines at k and N - k."""
    a = vec2(c * at[0] + s * at[1], s * at[0] - c * at[1])
    b = vec2(c * at[2] + s * at[3], s * at[2] - c * at[3])
    return vec4(a[0] - b[1], a[1] + b[0], a[0] + b[1], b[0] - a[1])


@ti.kernel
def _divide(src: f32_3, quarters: f32_2, down: f32_1, along: f32_1, out: f32_3):
    width = src.shape[1]
    size = ti.cast(down.shape[0], ti.f32) * width
    for i, k in ti.ndrange(src.shape[0], width // 2 + 1):
        other = (width - k) % width
        v = _apart(_at(src, i, k), _at(src, i, other))
        c = quarters[k, 0]
        s = quarters[k, 1]
        at = vec4(0.0)
        for line in ti.static(range(2)):
            row = ti.min(2 * i + line, down.shape[0] - 1)
            at[2 * line] = (c * v[2 * line] + s * v[2 * line + 1]) * _share(
                down[row], along[k], size
            )
            if k > 0:
                value = s * v[2 * line] - c * v[2 * line + 1]
                at[2 * line + 1] = value * _share(down[row], along[other], size)
        z = _together(c, s, at)
        out[i, k, 0] = z[0]
        out[i, k, 1] = z[1]
        if other != k:
            out[i, other, 0] = z[2]
            out[i, other, 1] = z[3]


@primitive
def divide(
    src: np.ndarray, quarters: np.ndarray, down: np.ndarray, along: np.ndarray, out: np.ndarray
) -> None:
    """Step 5: finish the transforms along rows, divide, and begin the inverse ones along rows.

    The divisors are the eigenvalues times the number of pixels.

    The parts of the eigenvalues are ``4 sin^2(pi k / 2H)`` down, (H,), and the like along, (W,).
    """
    _divide(src, quarters, down, along, out)


@ti.func
def _placed(src: ti.template(), k: ti.i32, height: ti.i32, x: ti.i32) -> ti.f32:
    """Return a value of pairs of rows, 0 outside of the image."""
    value = 0.0
    if k < height and x < src.shape[1]:
        value = src[k // 2, _place(x, src.shape[1]), k % 2]
    return value


@ti.kernel
def _back(src: f32_3, quarters: f32_2, out: f32_3):
    height = out.shape[0]
    for k, j in ti.ndrange(height // 2 + 1, out.shape[1]):
        at = vec4(0.0)
        for line in ti.static(range(2)):
            at[2 * line] = _placed(src, k, height, 2 * j + line)
            at[2 * line + 1] = _placed(src, height - k, height, 2 * j + line)
        z = _together(quarters[k, 0], quarters[k, 1], at)
        other = (height - k) % height
        out[k, j, 0] = z[0]
        out[k, j, 1] = z[1]
        if other != k:
            out[other, j, 0] = z[2]
            out[other, j, 1] = z[3]


@primitive
def back(src: np.ndarray, quarters: np.ndarray, out: np.ndarray) -> None:
    """Step 7: begin the inverse transforms along columns; those along rows are done."""
    _back(src, quarters, out)


@ti.kernel
def _end(src: f32_3, depth: f32_2):
    for y, x in depth:
        depth[y, x] = src[_place(y, depth.shape[0]), x // 2, x % 2]


@primitive
def end(src: np.ndarray, depth: np.ndarray) -> None:
    """Step 9: write the depth; rows were in Makhoul's order, and two columns were one."""
    _end(src, depth)
