"""The windows of keypoints in which orientations and descriptors are found, in Warp.

The Taichi set has the rules. One thread takes a point. Exponentials, cosines and sines are sums of
products and quotients in a fixed order, so that they have the same bits everywhere.
"""

import math

import warp as wp

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
from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LARGEST = wp.constant(REACH)
MOST_PEAKS = wp.constant(PEAKS)
LOG_2 = wp.constant(wp.float64(math.log(2.0)))
EXPONENTIAL = wp.constant(EXP_TERMS)
COSINE = wp.constant(COS_TERMS)
SIGMA = wp.constant(wp.float64(ORIENTATION_SIGMA))
CELL = wp.constant(wp.float64(CELL_SIDE))
ROOT_2 = wp.constant(wp.float64(math.sqrt(2.0)))
ACROSS = wp.constant(wp.float64(CELLS + 1))  # cells across a window, with half ones on both sides
SPREAD = wp.constant(wp.float64(CELLS / 2))  # sigma of the window, in cells
WHOLE = wp.constant(wp.float64(BINS))
HALF_TURN = wp.constant(wp.float64(BINS / 2 + 1e-9))
ANGLE = wp.constant(wp.float64(2 * math.pi / BINS))  # radians of a bin


def aim(
    found: Points,
    chosen: wp.array,
    number: wp.array,
    scales: Scales,
    windows: wp.array,
    spreads: wp.array,
) -> None:
    """Give the first `number` chosen points windows for their orientations; the others have none.

    A window is octave, level, row, column and radius; its octave is -1 if there is none.
    """
    count = windows.shape[0]
    inputs = [
        found.cells,
        found.offsets,
        chosen,
        number,
        wp.float64(scales.sigma),
        wp.float64(scales.levels),
    ]
    launch_each(_aim, count, 200 * count, inputs, [windows, spreads])


def repeat(
    found: Points,
    chosen: wp.array,
    number: wp.array,
    counts: wp.array,
    values: wp.array,
    squares: wp.array,
) -> None:
    """Repeat the values and squares of chosen points for each orientation; -1 for those without.

    Orientation k of point n has the place `PEAKS` n + k.
    """
    count = values.shape[0]
    inputs = [found.values, found.squares, chosen, number, counts]
    launch_each(_repeat, count, count, inputs, [values, squares])


def settle(
    found: Points,
    chosen: wp.array,
    places: wp.array,
    bins: wp.array,
    scales: Scales,
    settled: Settled,
) -> None:
    """List N points with an orientation, and the windows of their descriptors.

    `places` (at least N) are those of `repeat`, `bins` (M, PEAKS) the directions of chosen points.
    """
    count = settled.windows.shape[0]
    sizes = wp.vec3d(scales.sigma, float(scales.levels), scales.step)
    inputs = [found.cells, found.offsets, chosen, places, bins, sizes]
    outputs = [settled.windows, settled.turns, settled.scales]
    launch_each(_settle, count, 400 * count, inputs, outputs)
    inputs = [found.offsets, found.points, chosen, places, settled.turns]
    outputs = [settled.points, settled.orientations, settled.responses]
    launch_each(_list, count, 8 * count, inputs, outputs)


@wp.func
def exp2(x: wp.float64) -> wp.float64:
    """Return 2^x, for x in [-1, 3]."""
    y = x * LOG_2
    total = wp.float64(1.0)
    for k in range(EXPONENTIAL):  # total = 1 + y total / n
        total = total * y
        total = total / wp.float64(EXPONENTIAL - k)
        total = total + wp.float64(1.0)
    return total


@wp.func
def scale_of(
    cells: wp.array2d[int],
    offsets: wp.array2d[float],
    n: int,
    sigma: wp.float64,
    levels: wp.float64,
) -> float:
    """Return the scale of a point, in pixels of its octave; levels are counted from 1."""
    level = wp.float64(cells[n, 1]) + wp.float64(offsets[n, 2])
    return float(sigma * exp2(level / levels))


@wp.func
def radius_of(half: wp.float64) -> int:
    """Round half the side of a window."""
    return int(wp.min(wp.floor(half + wp.float64(0.5)), wp.float64(LARGEST)))


@wp.kernel
def _aim(
    stride: int,
    first: int,
    last: int,
    cells: wp.array2d[int],
    offsets: wp.array2d[float],
    chosen: wp.array[int],
    number: wp.array[int],
    sigma: wp.float64,
    levels: wp.float64,
    # outputs
    windows: wp.array2d[int],  # (M, 5)
    spreads: wp.array[float],
):
    for i in range(first + wp.tid(), last, stride):
        windows[i, 0] = -1
        if i < number[0]:
            n = chosen[i]
            for k in range(4):
                windows[i, k] = cells[n, k]
            size = SIGMA * wp.float64(scale_of(cells, offsets, n, sigma, levels))
            windows[i, 4] = radius_of(wp.float64(3.0) * size)
            spreads[i] = float(wp.float64(1.0) / (wp.float64(2.0) * size * size))


@wp.kernel
def _repeat(
    stride: int,
    first: int,
    last: int,
    values: wp.array[int],
    squares: wp.array[int],
    chosen: wp.array[int],
    number: wp.array[int],
    counts: wp.array[int],
    # outputs
    values_of: wp.array[int],
    squares_of: wp.array[int],
):
    for k in range(first + wp.tid(), last, stride):
        i = k // MOST_PEAKS
        value = int(-1)
        if i < number[0]:
            if k - i * MOST_PEAKS < counts[i]:
                value = values[chosen[i]]
                squares_of[k] = squares[chosen[i]]
        values_of[k] = value


@wp.kernel
def _settle(
    stride: int,
    first: int,
    last: int,
    cells: wp.array2d[int],
    offsets: wp.array2d[float],
    chosen: wp.array[int],
    places: wp.array[int],
    bins: wp.array2d[float],
    sizes: wp.vec3d,  # sigma, levels of an octave, pixel of the first one
    # outputs
    windows: wp.array2d[int],  # (N, 5)
    turns: wp.array2d[float],  # (N, 4): cosine and sine over a cell's side, angle, spread
    scales: wp.array[float],
):
    one = wp.float64(1.0)
    for j in range(first + wp.tid(), last, stride):
        i = places[j] // MOST_PEAKS
        n = chosen[i]
        bin = wp.float64(bins[i, places[j] - i * MOST_PEAKS])
        if bin >= HALF_TURN:
            bin = bin - WHOLE
        angle = float(bin * ANGLE)
        x = wp.float64(angle)
        square = x * x
        cosine = one
        sine = one
        for k in range(COSINE):  # cosine = 1 - square cosine / (m (m - 1)), sine alike
            m = 2 * (COSINE - k)
            cosine = one - cosine * square / wp.float64(m * (m - 1))
            sine = one - sine * square / wp.float64(m * (m + 1))
        sine = x * sine
        scale = scale_of(cells, offsets, n, sizes[0], sizes[1])
        side = CELL * wp.float64(scale)
        for k in range(4):
            windows[j, k] = cells[n, k]
        windows[j, 4] = radius_of(side * ROOT_2 * ACROSS / wp.float64(2.0))
        turns[j, 0] = float(cosine / side)
        turns[j, 1] = float(sine / side)
        turns[j, 2] = angle
        window = SPREAD * side
        turns[j, 3] = float(one / (wp.float64(2.0) * (window * window)))
        pixel = sizes[2]
        for _ in range(cells[n, 0]):
            pixel = pixel + pixel
        scales[j] = float(wp.float64(scale) * pixel)


@wp.kernel
def _list(
    stride: int,
    first: int,
    last: int,
    offsets: wp.array2d[float],
    points: wp.array2d[float],
    chosen: wp.array[int],
    places: wp.array[int],
    turns: wp.array2d[float],
    # outputs
    points_of: wp.array2d[float],
    orientations: wp.array[float],
    responses: wp.array[float],
):
    for j in range(first + wp.tid(), last, stride):
        n = chosen[places[j] // MOST_PEAKS]
        points_of[j, 0] = points[n, 0]
        points_of[j, 1] = points[n, 1]
        orientations[j] = turns[j, 2]
        responses[j] = offsets[n, 3]
