"""Menon's demosaicing on extended planes, in Taichi [Menon, Andriani and Calvagno 2007].

Green is interpolated along rows and along columns: the mean of both neighbours, and half of the
second difference of the measured colour. A pixel takes the direction along which the difference
between green and the measured colour changes less around it. Red and blue follow from the
differences between colours, and a last pass smooths these along that direction. One thread takes a
pixel.

The planes are the samples, red, blue, green and the direction. Red and blue first hold the
measured colour less green, by rows and by columns.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.raw import MARGIN, MENON_MARGINS, STRIP, Menon
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._rounding import product
from cvkern.kernels.taichi.raw.demosaicing import planes as extended

f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)

SAMPLES, RED, BLUE, GREEN, DIRECTION = range(5)
STEPS = [int(step) for step in Menon]
THIRD = float(np.float32(1) / np.float32(3))


@ti.func
def _pair(planes: f32_3, k: ti.i32, y: ti.i32, x: ti.i32, level: bool) -> ti.f32:
    """Return half of the sum of the two neighbours along a direction."""
    found = 0.0
    if level:
        found = 0.5 * (planes[k, y, x - 1] + planes[k, y, x + 1])
    else:
        found = 0.5 * (planes[k, y - 1, x] + planes[k, y + 1, x])
    return found


@ti.func
def _change(planes: f32_3, y: ti.i32, x: ti.i32, level: bool) -> ti.f32:
    """Return how much the differences of a direction change along it, in 5 x 5 pixels."""
    total = 0.0
    for k in ti.static(range(-2, 3)):
        if ti.static(k % 2 == 1):
            if level:
                total += ti.abs(planes[RED, y + k, x - 1] - planes[RED, y + k, x + 1])
            else:
                total += ti.abs(planes[BLUE, y - 1, x + k] - planes[BLUE, y + 1, x + k])
        else:
            weight = ti.static(3.0 if k == 0 else 1.0)
            if level:
                here = planes[RED, y + k, x]
                total += weight * ti.abs(here - planes[RED, y + k, x + 2])
                total += weight * ti.abs(planes[RED, y + k, x - 2] - here)
            else:
                here = planes[BLUE, y, x + k]
                total += weight * ti.abs(here - planes[BLUE, y + 2, x + k])
                total += weight * ti.abs(planes[BLUE, y - 2, x + k] - here)
    return total


@ti.func
def _mean(
    planes: f32_3, a: ti.i32, b: ti.i32, y: ti.i32, x: ti.i32, level: bool, zero: ti.i32
) -> ti.f32:
    """Return the mean difference between two planes of three pixels along a direction."""
    dy, dx = 1, 0
    if level:
        dy, dx = 0, 1
    before = planes[a, y - dy, x - dx] - planes[b, y - dy, x - dx]
    after = planes[a, y + dy, x + dx] - planes[b, y + dy, x + dx]
    here = planes[a, y, x] - planes[b, y, x]
    return product((before + here) + after, THIRD, zero)


@ti.kernel
def _menon(
    step: ti.i32,
    red_row: ti.i32,
    red_column: ti.i32,
    margin: ti.i32,
    zero: ti.i32,
    # outputs
    planes: f32_3,
):
    rows, columns = planes.shape[1] - margin, planes.shape[2] - margin
    for y, x in ti.ndrange((margin, rows), (margin, columns)):
        below = ti.cast((y & 1) != red_row, ti.i32)
        chroma = (x & 1) == (red_column ^ below)
        own, other = RED, BLUE
        if below == 1:
            own, other = BLUE, RED
        c = planes[SAMPLES, y, x]
        level = planes[DIRECTION, y, x] > 0.0
        if step == ti.static(STEPS[0]):
            far_h = planes[SAMPLES, y, x - 2] + planes[SAMPLES, y, x + 2]
            far_v = planes[SAMPLES, y - 2, x] + planes[SAMPLES, y + 2, x]
            h = _pair(planes, SAMPLES, y, x, True) + (0.5 * c - 0.25 * far_h)
            v = _pair(planes, SAMPLES, y, x, False) + (0.5 * c - 0.25 * far_v)
            planes[RED, y, x] = c - h if chroma else 0.0
            planes[BLUE, y, x] = c - v if chroma else 0.0
        elif step == ti.static(STEPS[1]):
            level = _change(planes, y, x, False) >= _change(planes, y, x, True)
            planes[DIRECTION, y, x] = 1.0 if level else 0.0
            planes[GREEN, y, x] = c - (planes[RED, y, x] if level else planes[BLUE, y, x])
        elif step == ti.static(STEPS[2]) and not chroma:
            planes[own, y, x] = (c + _pair(planes, SAMPLES, y, x, True)) - _pair(
                planes, GREEN, y, x, True
            )
            planes[other, y, x] = (c + _pair(planes, SAMPLES, y, x, False)) - _pair(
                planes, GREEN, y, x, False
            )
        elif step == ti.static(STEPS[3]) and chroma:
            planes[own, y, x] = c
            planes[other, y, x] = (c + _pair(planes, other, y, x, level)) - _pair(
                planes, own, y, x, level
            )
        elif step == ti.static(STEPS[4]) and chroma:
            planes[GREEN, y, x] = planes[own, y, x] - _mean(planes, own, GREEN, y, x, level, zero)
        elif step == ti.static(STEPS[5]) and not chroma:
            green = planes[GREEN, y, x]
            before = planes[own, y, x - 1] - planes[GREEN, y, x - 1]
            after = planes[own, y, x + 1] - planes[GREEN, y, x + 1]
            planes[own, y, x] = green + 0.5 * (before + after)
            before = planes[other, y - 1, x] - planes[GREEN, y - 1, x]
            after = planes[other, y + 1, x] - planes[GREEN, y + 1, x]
            planes[other, y, x] = green + 0.5 * (before + after)
        elif step == ti.static(STEPS[6]) and chroma:
            planes[other, y, x] = planes[own, y, x] + _mean(planes, other, own, y, x, level, zero)


@primitive
def menon(raw: np.ndarray, red_row: int, red_column: int, colours: np.ndarray) -> None:
    """Fill in the two colours that each pixel misses; red is at (red_row, red_column).

    The steps go over a strip of rows after the other; one thread a pixel.
    """
    height, width = raw.shape
    for top in range(0, height, 4 * STRIP):
        rows = min(4 * STRIP, height - top)
        strip = scratch((5, rows + 2 * MARGIN, width + 2 * MARGIN), np.float32)
        extended.extend(raw, top, strip)
        for step, margin in zip(Menon, MENON_MARGINS, strict=True):
            _menon(int(step), red_row, red_column, margin, 0, strip)
        extended.join(strip, RED, GREEN, BLUE, top, rows, colours)
