"""Histograms and tone curves in Warp; the Taichi set has the rules.

One thread takes a pixel; on the CPU, a slab of pixels, except for counting, which one thread does.
"""

import warp as wp

from cvkern.kernels.codes.color import LEVELS, TONES
from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_MOST = wp.constant(float(LEVELS - 1))
_TONES = wp.constant(TONES)
# Threads of the CPU share counters, so one of them counts: a slab is never cut.
_WHOLE = 0


def levels(image: wp.array, scale: float, found: wp.array, counts: wp.array) -> None:
    """Round the largest channel of (N, C) values, scaled, and count levels."""
    launch_each(_levels, found.shape[0], _WHOLE, [image, scale], [found, counts])


def tiles(
    found: wp.array, bins: wp.array, rows: wp.array, columns: wp.array, counts: wp.array
) -> None:
    """Count (R, C, B) the bins of levels in tiles, whose pixels `rows` and `columns` name."""
    count = rows.shape[0] * columns.shape[0]
    launch_each(_tiles, count, _WHOLE, [found, bins, rows, columns], [counts])


def blend(
    found: wp.array,
    bins: wp.array,
    maps: wp.array,
    shares: wp.array,
    height: int,
    mixed: wp.array,
    counts: wp.array,
) -> None:
    """Mix the tones that the four nearest tiles map a pixel to, and count what comes out.

    `shares` are the weights of the lower tiles for each row of one of that height, then of the
    right ones for each column.
    """
    inputs = [found, bins, maps, shares, height]
    launch_each(_blend, found.size, _WHOLE, inputs, [mixed, counts])


def look_up(image: wp.array, found: wp.array, table: wp.array, out: wp.array) -> None:
    """Replace the largest channel of (N, C) values by the table's, and scale the others with it."""
    launch_each(_look_up, out.shape[0], 8 * out.size, [image, found, table], [out])


def count(image: wp.array, edges: wp.array, counts: wp.array) -> None:
    """Count the values in bins between edges; the last edge belongs to the last bin."""
    launch_each(_count, image.shape[0], _WHOLE, [image, edges], [counts])


def curve(
    image: wp.array, centres: wp.array, heights: wp.array, slopes: wp.array, out: wp.array
) -> None:
    """Read a broken line through (centre, height) with these slopes at each value, in float64."""
    launch_each(_curve, out.shape[0], 8 * out.size, [image, centres, heights, slopes], [out])


@wp.kernel
def _levels(
    stride: int,
    first: int,
    last: int,
    image: wp.array2d[float],
    scale: float,
    # outputs
    found: wp.array[int],
    counts: wp.array[int],
):
    for i in range(first + wp.tid(), last, stride):
        value = image[i, 0]
        for c in range(1, image.shape[1]):
            value = wp.max(value, image[i, c])
        value = wp.clamp(value * scale, 0.0, _MOST)
        whole = int(value)
        rest = value - float(whole)
        # The nearest, and of two the even one, as NumPy rounds.
        if rest > 0.5 or (rest == 0.5 and whole % 2 == 1):
            whole += 1
        found[i] = whole
        wp.atomic_add(counts, whole, 1)


@wp.kernel
def _tiles(
    stride: int,
    first: int,
    last: int,
    found: wp.array2d[int],
    bins: wp.array[int],
    rows: wp.array[int],
    columns: wp.array[int],
    # outputs
    counts: wp.array3d[int],
):
    height = rows.shape[0] // counts.shape[0]
    width = columns.shape[0] // counts.shape[1]
    for i in range(first + wp.tid(), last, stride):
        y = i // columns.shape[0]
        x = i % columns.shape[0]
        code = bins[found[rows[y], columns[x]]]
        wp.atomic_add(counts, y // height, x // width, code, 1)


@wp.func
def _share(value: int, weight: wp.float64):
    return wp.float32(wp.float64(value) * weight)


@wp.kernel
def _blend(
    stride: int,
    first: int,
    last: int,
    found: wp.array2d[int],
    bins: wp.array[int],
    maps: wp.array3d[int],
    shares: wp.array[wp.float64],
    height: int,
    # outputs
    mixed: wp.array2d[int],
    counts: wp.array[int],
):
    one = wp.float64(1.0)
    width = shares.shape[0] - height
    for i in range(first + wp.tid(), last, stride):
        y = i // found.shape[1]
        x = i % found.shape[1]
        py = y + height // 2
        px = x + width // 2
        top = wp.max(py // height - 1, 0)
        bottom = wp.min(py // height, maps.shape[0] - 1)
        left = wp.max(px // width - 1, 0)
        right = wp.min(px // width, maps.shape[1] - 1)
        v = shares[py % height]
        u = shares[height + px % width]
        code = bins[found[y, x]]
        total = _share(maps[top, left, code], (one - u) * (one - v))
        total += _share(maps[top, right, code], u * (one - v))
        total += _share(maps[bottom, left, code], (one - u) * v)
        total += _share(maps[bottom, right, code], u * v)
        tone = wp.min(int(total), _TONES - 1)
        mixed[y, x] = tone
        wp.atomic_add(counts, tone, 1)


@wp.kernel
def _look_up(
    stride: int,
    first: int,
    last: int,
    image: wp.array2d[float],
    found: wp.array[int],
    table: wp.array[float],
    # outputs
    out: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        new = table[found[i]]
        value = image[i, 0]
        for c in range(1, out.shape[1]):
            value = wp.max(value, image[i, c])
        for c in range(out.shape[1]):
            if out.shape[1] > 1 and value > 0.0:
                out[i, c] = image[i, c] * new / value
            else:
                out[i, c] = new


@wp.func
def _place(steps: wp.array[wp.float64], value: wp.float64, count: int):
    low = int(0)
    high = count
    while high - low > 1:
        middle = (low + high) // 2
        if value >= steps[middle]:
            low = middle
        else:
            high = middle
    return low


@wp.kernel
def _count(
    stride: int,
    first: int,
    last: int,
    image: wp.array[float],
    edges: wp.array[wp.float64],
    # outputs
    counts: wp.array[int],
):
    for i in range(first + wp.tid(), last, stride):
        low = _place(edges, wp.float64(image[i]), counts.shape[0])
        wp.atomic_add(counts, low, 1)


@wp.kernel
def _curve(
    stride: int,
    first: int,
    last: int,
    image: wp.array[float],
    centres: wp.array[wp.float64],
    heights: wp.array[wp.float64],
    slopes: wp.array[wp.float64],
    # outputs
    out: wp.array[float],
):
    count = centres.shape[0]
    for i in range(first + wp.tid(), last, stride):
        value = wp.clamp(wp.float64(image[i]), centres[0], centres[count - 1])
        low = _place(centres, value, count - 1)
        out[i] = wp.float32(heights[low] + slopes[low] * (value - centres[low]))
