"""Residual interpolation on extended planes, in Taichi.

A line of pixels measures green and one other colour in turns. At pixel i, p is the sample, and q is
the mean of its two neighbours, which have the other colour. Each window of 13 pixels fits
``p = a q + b`` to every second pixel (`_fit`). The mean of the lines of all windows that contain a
pixel gives its tentative value t. The residual at the samples, ``r = p - t``, is interpolated, so
the other colour at i is ``t + (r[i-1] + r[i+1]) / 2`` [Kiku et al. 2016]. The difference d is green
less the other colour; rows have one, and columns another.

In 5 x 5 pixels, g is the energy of the slope of d, and h is that of the texture, which causes the
errors of d. Of its difference from its mean along the line, d keeps the share
``g^2 / (g^2 + SMOOTH h^2)``. Both directions are weighted by the inverse square of how much d
changes. Red and blue then follow from green by windows of 7 x 7 pixels. One thread takes a pixel or
a line.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.raw import (
    BORDER,
    FLAT,
    MARGINS,
    PRIOR,
    SETTLED,
    SMOOTH,
    STEADY,
    TINY,
    WINDOW_PRIOR,
    Step,
)
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._rounding import product, quotient
from cvkern.kernels.taichi.raw.demosaicing._fit import fit, vec8

f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
vec3 = ti.types.vector(3, ti.f32)

SEVENTH, SIXTH, NINTH = (float(np.float32(1) / np.float32(n)) for n in (7, 6, 9))
# Planes of a direction's scratch: deviations, lines of windows of both kinds, residuals.
U, V, EVEN, ODD, REST = 0, 1, 2, 5, 8
GREEN, LEFT, TENTATIVE = 3, 4, 9


@ti.func
def _sample(a: f32_3, k: ti.i32, y: ti.i32, x: ti.i32, n: ti.i32, vertical: ti.i32) -> ti.f32:
    """Return the element n pixels along the line."""
    return a[k, y + n * vertical, x + n * (1 - vertical)]


@ti.func
def _settled(value: ti.f32) -> ti.f32:
    """Return an estimate, or 0 if it is so small that it is the rounding error of a zero."""
    return 0.0 if ti.abs(value) < ti.cast(SETTLED, ti.f32) else value


@ti.func
def _guide(planes: f32_3, y: ti.i32, x: ti.i32, n: ti.i32, vertical: ti.i32) -> ti.f32:
    before = _sample(planes, 0, y, x, n - 1, vertical)
    return 0.5 * (before + _sample(planes, 0, y, x, n + 1, vertical))


@ti.kernel
def _deviations(planes: f32_3, vertical: ti.i32, zero: ti.i32, work: f32_3):
    top, left = 7 * vertical, 7 * (1 - vertical)
    rows, columns = planes.shape[1] - top, planes.shape[2] - left
    for y, x in ti.ndrange((top, rows), (left, columns)):
        p, q = 0.0, 0.0
        for k in ti.static(range(-6, 7, 2)):
            p += _sample(planes, 0, y, x, k, vertical)
            q += _guide(planes, y, x, k, vertical)
        work[U, y, x] = planes[0, y, x] - product(p, SEVENTH, zero)
        work[V, y, x] = _guide(planes, y, x, 0, vertical) - product(q, SEVENTH, zero)


@ti.func
def _moments(
    planes: f32_3, work: f32_3, y: ti.i32, x: ti.i32, n: ti.i32, vertical: ti.i32, zero: ti.i32
) -> vec8:
    """Return the summands of a sample in the sums of a window."""
    p, q = _sample(planes, 0, y, x, n, vertical), _guide(planes, y, x, n, vertical)
    u, v = _sample(work, U, y, x, n, vertical), _sample(work, V, y, x, n, vertical)
    return _products(p, q, u, v, zero)


@ti.func
def _products(p: ti.f32, q: ti.f32, u: ti.f32, v: ti.f32, zero: ti.i32) -> vec8:
    return vec8(
        p,
        q,
        product(u, v, zero),
        product(v, v, zero),
        product(u, u, zero),
        product(p, p, zero),
        product(p, q, zero),
        product(q, q, zero),
    )


@ti.kernel
def _lines(planes: f32_3, vertical: ti.i32, zero: ti.i32, work: f32_3):
    top, left = 13 * vertical, 13 * (1 - vertical)
    rows, columns = planes.shape[1] - top, planes.shape[2] - left
    for y, x in ti.ndrange((top, rows), (left, columns)):
        sums = vec8(0.0)
        for k in range(7):
            sums += _moments(planes, work, y, x, 2 * k - 6, vertical, zero)
        even = fit(_scaled(sums, SEVENTH, zero), PRIOR, zero)
        sums = vec8(0.0)
        for k in range(6):
            sums += _moments(planes, work, y, x, 2 * k - 5, vertical, zero)
        odd = fit(_scaled(sums, SIXTH, zero), PRIOR, zero)
        for k in ti.static(range(3)):
            work[EVEN + k, y, x] = even[k]
            work[ODD + k, y, x] = odd[k]


@ti.func
def _scaled(sums: vec8, share: ti.f32, zero: ti.i32) -> vec8:
    means = sums
    for k in ti.static(range(8)):
        means[k] = product(sums[k], share, zero)
    return means


@ti.func
def _mean_line(
    work: f32_3, here: ti.i32, beside: ti.i32, y: ti.i32, x: ti.i32, vertical: ti.i32
) -> vec3:
    """Add up the lines of the windows that see a pixel: `here` at even places, `beside` at odd."""
    even, odd = vec3(0.0), vec3(0.0)
    for k in range(7):
        for c in ti.static(range(3)):
            even[c] += _sample(work, here + c, y, x, 2 * k - 6, vertical)
    for k in range(6):
        for c in ti.static(range(3)):
            odd[c] += _sample(work, beside + c, y, x, 2 * k - 5, vertical)
    return even + odd


@ti.kernel
def _rest(planes: f32_3, vertical: ti.i32, zero: ti.i32, work: f32_3):
    top, left = 19 * vertical, 19 * (1 - vertical)
    rows, columns = planes.shape[1] - top, planes.shape[2] - left
    for y, x in ti.ndrange((top, rows), (left, columns)):
        line = _mean_line(work, EVEN, ODD, y, x, vertical)
        value = product(line[1], _guide(planes, y, x, 0, vertical), zero) + line[2]
        work[REST, y, x] = planes[0, y, x] - _settled(quotient(value, line[0], zero))


@ti.kernel
def _differences(vertical: ti.i32, odd: ti.i32, zero: ti.i32, work: f32_3, planes: f32_3):
    top, left = 20 * vertical, 20 * (1 - vertical)
    rows, columns = planes.shape[1] - top, planes.shape[2] - left
    for y, x in ti.ndrange((top, rows), (left, columns)):
        p = planes[0, y, x]
        line = _mean_line(work, ODD, EVEN, y, x, vertical)
        before = _sample(work, REST, y, x, -1, vertical)
        rest = 0.5 * (before + _sample(work, REST, y, x, 1, vertical))
        found = _settled(quotient(product(line[1], p, zero) + line[2], line[0], zero) + rest)
        planes[1 + vertical, y, x] = p - found if (y + x + odd) & 1 else found - p


@primitive
def directions(red_row: int, red_column: int, planes: np.ndarray) -> None:
    """Find the differences between green and the other colour, by rows and by columns.

    One thread a pixel.
    """
    work = scratch((9, *planes.shape[1:]), np.float32)
    for vertical in (0, 1):
        _deviations(planes, vertical, 0, work)
        _lines(planes, vertical, 0, work)
        _rest(planes, vertical, 0, work)
        _differences(vertical, red_row + red_column, 0, work, planes)


@ti.kernel
def _green(red_row: ti.i32, red_column: ti.i32, zero: ti.i32, planes: f32_3):
    rows, columns = planes.shape[1] - BORDER, planes.shape[2] - BORDER
    for y, x in ti.ndrange((BORDER, rows), (BORDER, columns)):
        p = planes[0, y, x]
        total, weights = 0.0, 0.0
        for k in ti.static(range(2)):
            sums = vec3(0.0)
            for dx in range(-2, 3):
                column = vec3(0.0)
                for dy in range(-2, 3):
                    column += _energies(planes, k, y + dy, x + dx, zero)
                sums += column
            texture, slope, change = sums[0], sums[1], product(0.04, sums[2], zero)
            here = planes[1 + k, y, x]
            ends = _ends(planes, 1 + k, y, x, 3, k) + 2.0 * _ends(planes, 1 + k, y, x, 2, k)
            inner = product(3.0, _ends(planes, 1 + k, y, x, 1, k), zero) + 4.0 * here
            mean = 0.0625 * (ends + inner)
            own = product(slope, slope, zero)
            noise = product(ti.cast(SMOOTH, ti.f32), product(texture, texture, zero), zero)
            share = quotient(own, (own + noise) + TINY, zero)
            found = mean + product(here - mean, share, zero)
            flat = product(ti.cast(FLAT, ti.f32), product(p, p, zero), zero)
            w = quotient(1.0, (product(change, change, zero) + flat) + TINY, zero)
            weights += w
            total += product(w, found, zero)
        green = p
        if ((y + x + red_row + red_column) & 1) == 0:
            green = _settled(p + quotient(total, weights, zero))
        planes[GREEN, y, x] = green


@ti.func
def _ends(planes: f32_3, k: ti.i32, y: ti.i32, x: ti.i32, n: ti.i32, vertical: ti.i32) -> ti.f32:
    return _sample(planes, k, y, x, -n, vertical) + _sample(planes, k, y, x, n, vertical)


@ti.func
def _energies(planes: f32_3, k: ti.i32, y: ti.i32, x: ti.i32, zero: ti.i32) -> vec3:
    """Return the squared texture and slope of a direction, and the change of its difference."""
    fine = 0.5 * planes[0, y, x] - 0.25 * _ends(planes, 0, y, x, 2, k)
    d = 1 + k
    after = _sample(planes, d, y, x, 1, k) + _sample(planes, d, y, x, 3, k)
    after += 2.0 * _sample(planes, d, y, x, 2, k)
    before = _sample(planes, d, y, x, -3, k) + _sample(planes, d, y, x, -1, k)
    before += 2.0 * _sample(planes, d, y, x, -2, k)
    rise = 0.125 * (after - before)
    change = ti.abs(_sample(planes, d, y, x, 1, k) - _sample(planes, d, y, x, -1, k))
    return vec3(product(fine, fine, zero), product(rise, rise, zero), change)


@primitive
def green(red_row: int, red_column: int, planes: np.ndarray) -> None:
    """Find green from the differences of both directions; one thread a pixel."""
    _green(red_row, red_column, 0, planes)


@ti.func
def _window_mean(planes: f32_3, k: ti.i32, y: ti.i32, x: ti.i32, zero: ti.i32) -> ti.f32:
    total = 0.0
    for dx in ti.static((-2, 0, 2)):
        total += (planes[k, y - 2, x + dx] + planes[k, y, x + dx]) + planes[k, y + 2, x + dx]
    return product(total, NINTH, zero)


@ti.kernel
def _window_deviations(margin: ti.i32, row: ti.i32, column: ti.i32, zero: ti.i32, planes: f32_3):
    rows, columns = planes.shape[1] - margin, planes.shape[2] - margin
    for y, x in ti.ndrange((margin, rows), (margin, columns)):
        if (y & 1) == row and (x & 1) == column:
            planes[4, y, x] = planes[0, y, x] - _window_mean(planes, 0, y, x, zero)
            planes[5, y, x] = planes[GREEN, y, x] - _window_mean(planes, GREEN, y, x, zero)


@ti.kernel
def _windows(margin: ti.i32, row: ti.i32, column: ti.i32, zero: ti.i32, planes: f32_3):
    rows, columns = planes.shape[1] - margin, planes.shape[2] - margin
    for y, x in ti.ndrange((margin, rows), (margin, columns)):
        tall = 3 if (y & 1) == row else 4
        wide = 3 if (x & 1) == column else 4
        total = vec8(0.0)
        for c in range(wide):
            u = x + 2 * c - wide + 1
            sums = vec8(0.0)
            for r in range(tall):
                v = y + 2 * r - tall + 1
                sums += _products(
                    planes[0, v, u], planes[GREEN, v, u], planes[4, v, u], planes[5, v, u], zero
                )
            total += sums
        share = quotient(1.0, ti.cast(tall * wide, ti.f32), zero)
        line = fit(_scaled(total, share, zero), WINDOW_PRIOR, zero)
        for k in ti.static(range(3)):
            planes[6 + k, y, x] = line[k]


@ti.kernel
def _tentative(margin: ti.i32, zero: ti.i32, planes: f32_3):
    rows, columns = planes.shape[1] - margin, planes.shape[2] - margin
    for y, x in ti.ndrange((margin, rows), (margin, columns)):
        line = vec3(0.0)
        for dx in range(-3, 4):
            sums = vec3(0.0)
            for dy in range(-3, 4):
                for k in ti.static(range(3)):
                    sums[k] += planes[6 + k, y + dy, x + dx]
            line += sums
        value = product(line[1], planes[GREEN, y, x], zero) + line[2]
        planes[TENTATIVE, y, x] = _settled(quotient(value, line[0], zero))
        planes[LEFT, y, x] = planes[0, y, x] - planes[TENTATIVE, y, x]


@ti.func
def _change(planes: f32_3, y: ti.i32, x: ti.i32, dy: ti.i32, dx: ti.i32) -> ti.f32:
    return ti.abs(planes[LEFT, y - dy, x - dx] - planes[LEFT, y + dy, x + dx])


@ti.func
def _between(
    planes: f32_3, y: ti.i32, x: ti.i32, dy: ti.i32, dx: ti.i32, side: ti.i32, zero: ti.i32
) -> ti.f32:
    """Return the mean of two pairs of neighbours: those at (dy, dx), and those across.

    A pair weighs as the inverse fourth power of its change, here and at the four nearest pixels of
    the same kind, along the sides or the diagonals; changes that are small beside green do not
    count.
    """
    ey, ex = dx, -dy
    one, other = 2.0 * _change(planes, y, x, dy, dx), 2.0 * _change(planes, y, x, ey, ex)
    one += _around(planes, y, x, dy, dx, side)
    other += _around(planes, y, x, ey, ex, side)
    one, other = product(one, SIXTH, zero), product(other, SIXTH, zero)
    flat = product(ti.cast(STEADY, ti.f32), ti.abs(planes[GREEN, y, x]), zero)
    scale = quotient(1.0, ((one + other) + flat) + TINY, zero)
    least = _fourth(flat, scale, zero) + TINY
    a = _fourth(one, scale, zero) + least
    b = _fourth(other, scale, zero) + least
    first = 0.5 * (planes[LEFT, y - dy, x - dx] + planes[LEFT, y + dy, x + dx])
    second = 0.5 * (planes[LEFT, y - ey, x - ex] + planes[LEFT, y + ey, x + ex])
    return second + product(quotient(b, a + b, zero), first - second, zero)


@ti.func
def _around(planes: f32_3, y: ti.i32, x: ti.i32, dy: ti.i32, dx: ti.i32, side: ti.i32) -> ti.f32:
    found = 0.0
    if side == 2:
        found = _change(planes, y - 2, x, dy, dx) + _change(planes, y, x - 2, dy, dx)
        found += _change(planes, y, x + 2, dy, dx) + _change(planes, y + 2, x, dy, dx)
    else:
        found = _change(planes, y - 1, x - 1, dy, dx) + _change(planes, y - 1, x + 1, dy, dx)
        found += _change(planes, y + 1, x - 1, dy, dx) + _change(planes, y + 1, x + 1, dy, dx)
    return found


@ti.func
def _fourth(value: ti.f32, scale: ti.f32, zero: ti.i32) -> ti.f32:
    scaled = product(value, scale, zero)
    squared = product(scaled, scaled, zero)
    return product(squared, squared, zero)


@ti.kernel
def _diagonal(margin: ti.i32, row: ti.i32, column: ti.i32, zero: ti.i32, planes: f32_3):
    rows, columns = planes.shape[1] - margin, planes.shape[2] - margin
    for y, x in ti.ndrange((margin, rows), (margin, columns)):
        if (y & 1) != row and (x & 1) != column:
            planes[LEFT, y, x] = _between(planes, y, x, 1, 1, 2, zero)


@ti.kernel
def _residual(
    margin: ti.i32, row: ti.i32, column: ti.i32, result: ti.i32, zero: ti.i32, planes: f32_3
):
    rows, columns = planes.shape[1] - margin, planes.shape[2] - margin
    for y, x in ti.ndrange((margin, rows), (margin, columns)):
        here, on = (y & 1) == row, (x & 1) == column
        found = planes[0, y, x]
        if here != on:
            found = _settled(planes[TENTATIVE, y, x] + _between(planes, y, x, 0, 1, 1, zero))
        elif not here:
            found = _settled(planes[TENTATIVE, y, x] + planes[LEFT, y, x])
        planes[result, y, x] = found


@primitive
def chroma(step: int, row: int, column: int, result: int, planes: np.ndarray) -> None:
    """Do a step towards the colour whose samples are at (row, column) of each cell.

    One thread a pixel.
    """
    margin = MARGINS[Step(step)]
    if step == Step.DEVIATIONS:
        _window_deviations(margin, row, column, 0, planes)
    elif step == Step.WINDOWS:
        _windows(margin, row, column, 0, planes)
    elif step == Step.TENTATIVE:
        _tentative(margin, 0, planes)
    elif step == Step.DIAGONAL:
        _diagonal(margin, row, column, 0, planes)
    else:
        _residual(margin, row, column, result, 0, planes)
