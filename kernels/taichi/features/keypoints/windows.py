"""The windows of keypoints in which orientations and descriptors are found, in Taichi.

The scale of a point is ``sigma 2^(level / levels)`` pixels of its octave. The window of an
orientation has a Gaussian weight of 1.5 scales, the cells of a descriptor have sides of 3 scales,
turned by the orientation, with a Gaussian weight of two cells [D. G. Lowe, IJCV 60(2), 2004]. One
thread takes a point. Exponentials, cosines and sines are sums of products and quotients in a fixed
order, so that they have the same bits everywhere.
"""

import math

import numpy as np
import taichi as ti

from cvkern.kernels.codes.features import (
    BINS,
    CELL_SIDE,
    CELLS,
    COS_TERMS,
    EXP_TERMS,
    ORIENTATION_SIGMA,
    PEAKS,
    REACH,
    Points,
    Scales,
    Settled,
)
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import wide_product

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)

LOG_2, ROOT_2 = math.log(2.0), math.sqrt(2.0)
ANGLE = 2 * math.pi / BINS  # radians of a bin


@primitive
def aim(
    found: Points,
    chosen: np.ndarray,
    number: np.ndarray,
    scales: Scales,
    windows: np.ndarray,
    spreads: np.ndarray,
) -> None:
    """Give the first `number` chosen points windows for their orientations; the others have none.

    A window is octave, level, row, column and radius; its octave is -1 if there is none.
    """
    cells, offsets = found.cells, found.offsets
    _aim(cells, offsets, chosen, number, scales.sigma, scales.levels, 0, windows, spreads)


@primitive
def repeat(
    found: Points,
    chosen: np.ndarray,
    number: np.ndarray,
    counts: np.ndarray,
    values: np.ndarray,
    squares: np.ndarray,
) -> None:
    """Repeat the values and squares of chosen points for each orientation; -1 for those without.

    Orientation k of point n has the place `PEAKS` n + k.
    """
    _repeat(found.values, found.squares, chosen, number, counts, values, squares)


@primitive
def settle(
    found: Points,
    chosen: np.ndarray,
    places: np.ndarray,
    bins: np.ndarray,
    scales: Scales,
    settled: Settled,
) -> None:
    """List N points with an orientation, and the windows of their descriptors.

    `places` (at least N) are those of `repeat`, `bins` (M, PEAKS) the directions of chosen points.
    """
    cells, offsets = found.cells, found.offsets
    outputs = settled.windows, settled.turns, settled.scales
    _settle(cells, offsets, chosen, places, bins, *scales, 0, *outputs)
    outputs = settled.points, settled.orientations, settled.responses
    _list(offsets, found.points, chosen, places, settled.turns, *outputs)


@ti.func
def _exp2(x: ti.f64, zero: ti.i32) -> ti.f64:
    """Return 2^x, for x in [-1, 3]."""
    y = x * ti.f64(LOG_2)
    total = ti.cast(1.0, ti.f64)
    for k in range(EXP_TERMS):  # total = 1 + y total / n
        total = wide_product(total, y, zero) / ti.cast(EXP_TERMS - k, ti.f64) + 1.0
    return total


@ti.func
def _scale(
    cells: ti.template(),
    offsets: ti.template(),
    n: ti.i32,
    sigma: ti.f64,
    levels: ti.i32,
    zero: ti.i32,
) -> ti.f32:
    """Return the scale of a point, in pixels of its octave; levels are counted from 1."""
    level = ti.cast(cells[n, 1], ti.f64) + ti.cast(offsets[n, 2], ti.f64)
    return ti.cast(sigma * _exp2(level / ti.cast(levels, ti.f64), zero), ti.f32)


@ti.func
def _radius(half: ti.f64) -> ti.i32:
    """Round half the side of a window."""
    return ti.cast(ti.min(ti.floor(half + 0.5), ti.cast(REACH, ti.f64)), ti.i32)


@ti.kernel
def _aim(
    cells: i32_2,
    offsets: f32_2,
    chosen: i32_1,
    number: i32_1,
    sigma: ti.f64,
    levels: ti.i32,
    zero: ti.i32,
    # outputs
    windows: i32_2,  # (M, 5)
    spreads: f32_1,
):
    for i in spreads:
        windows[i, 0] = -1
        if i < number[0]:
            n = chosen[i]
            for k in range(4):
                windows[i, k] = cells[n, k]
            scale = ti.cast(_scale(cells, offsets, n, sigma, levels, zero), ti.f64)
            size = ti.f64(ORIENTATION_SIGMA) * scale
            windows[i, 4] = _radius(wide_product(ti.cast(3.0, ti.f64), size, zero))
            spreads[i] = ti.cast(1.0 / (2.0 * size * size), ti.f32)


@ti.kernel
def _repeat(
    values: i32_1,
    squares: i32_1,
    chosen: i32_1,
    number: i32_1,
    counts: i32_1,
    # outputs
    values_of: i32_1,
    squares_of: i32_1,
):
    for k in values_of:
        i = k // PEAKS
        values_of[k] = -1
        if i < number[0]:
            if k - i * PEAKS < counts[i]:
                values_of[k] = values[chosen[i]]
                squares_of[k] = squares[chosen[i]]


@ti.kernel
def _settle(
    cells: i32_2,
    offsets: f32_2,
    chosen: i32_1,
    places: i32_1,
    bins: f32_2,
    sigma: ti.f64,
    levels: ti.i32,
    step: ti.f64,
    zero: ti.i32,
    # outputs
    windows: i32_2,  # (N, 5)
    turns: f32_2,  # (N, 4): cosine and sine over a cell's side, angle, spread
    scales: f32_1,
):
    for j in scales:
        i = places[j] // PEAKS
        n = chosen[i]
        bin = ti.cast(bins[i, places[j] - i * PEAKS], ti.f64)
        if bin >= ti.f64(BINS / 2 + 1e-9):
            bin = bin - BINS
        angle = ti.cast(bin * ti.f64(ANGLE), ti.f32)
        x = ti.cast(angle, ti.f64)
        square = x * x
        cosine = ti.cast(1.0, ti.f64)
        sine = ti.cast(1.0, ti.f64)
        for k in range(COS_TERMS):  # cosine = 1 - square cosine / (m (m - 1)), sine alike
            m = 2 * (COS_TERMS - k)
            cosine = 1.0 - wide_product(cosine, square, zero) / ti.cast(m * (m - 1), ti.f64)
            sine = 1.0 - wide_product(sine, square, zero) / ti.cast(m * (m + 1), ti.f64)
        sine = x * sine
        scale = _scale(cells, offsets, n, sigma, levels, zero)
        side = ti.f64(CELL_SIDE) * ti.cast(scale, ti.f64)
        for k in range(4):
            windows[j, k] = cells[n, k]
        half = wide_product(side * ti.f64(ROOT_2), CELLS + 1.0, zero) / 2.0
        windows[j, 4] = _radius(half)
        turns[j, 0] = ti.cast(cosine / side, ti.f32)
        turns[j, 1] = ti.cast(sine / side, ti.f32)
        turns[j, 2] = angle
        window = CELLS / 2 * side
        turns[j, 3] = ti.cast(1.0 / (2.0 * (window * window)), ti.f32)
        pixel = step
        for _ in range(cells[n, 0]):
            pixel = pixel + pixel
        scales[j] = ti.cast(ti.cast(scale, ti.f64) * pixel, ti.f32)


@ti.kernel
def _list(
    offsets: f32_2,
    points: f32_2,
    chosen: i32_1,
    places: i32_1,
    turns: f32_2,
    # outputs
    points_of: f32_2,
    orientations: f32_1,
    responses: f32_1,
):
    for j in responses:
        n = chosen[places[j] // PEAKS]
        points_of[j, 0] = points[n, 0]
        points_of[j, 1] = points[n, 1]
        orientations[j] = turns[j, 2]
        responses[j] = offsets[n, 3]
