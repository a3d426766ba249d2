"""Histograms and tone curves, in Taichi.

CLAHE [Zuiderveld 1994]: each tile of an image has a histogram, cut off at a limit, whose sums map
its bins to tones; a pixel gets the mean of what the four nearest tiles say, by its distance to
their middles. Counters are integers, so they do not depend on the order of the pixels.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.color import LEVELS, TONES
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient, wide_product

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f64_1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)


@ti.kernel
def _levels(image: f32_2, scale: ti.f32, zero: ti.i32, found: i32_1, counts: i32_1):
    for i in range(found.shape[0]):
        value = image[i, 0]
        for c in range(1, image.shape[1]):
            value = ti.max(value, image[i, c])
        value = ti.math.clamp(product(value, scale, zero), 0.0, float(LEVELS - 1))
        whole = ti.cast(value, ti.i32)
        rest = value - ti.cast(whole, ti.f32)
        # The nearest, and of two the even one, as NumPy rounds.
        if rest > 0.5 or (rest == 0.5 and whole % 2 == 1):
            whole += 1
        found[i] = whole
        ti.atomic_add(counts[whole], 1)


@primitive
def levels(image: np.ndarray, scale: float, found: np.ndarray, counts: np.ndarray) -> None:
    """Round the largest channel of (N, C) values, scaled, and count levels.

    One thread a pixel.
    """
    _levels(image, scale, 0, found, counts)


@ti.kernel
def _tiles(found: i32_2, bins: i32_1, rows: i32_1, columns: i32_1, counts: i32_3):
    height = rows.shape[0] // counts.shape[0]
    width = columns.shape[0] // counts.shape[1]
    for y, x in ti.ndrange(rows.shape[0], columns.shape[0]):
        code = bins[found[rows[y], columns[x]]]
        ti.atomic_add(counts[y // height, x // width, code], 1)


@primitive
def tiles(
    found: np.ndarray, bins: np.ndarray, rows: np.ndarray, columns: np.ndarray, counts: np.ndarray
) -> None:
    """Count (R, C, B) the bins of levels in tiles, whose pixels `rows` and `columns` name.

    One thread a pixel of a tile.
    """
    _tiles(found, bins, rows, columns, counts)


@ti.func
def _share(value: ti.i32, weight: ti.f64, zero: ti.i32) -> ti.f32:
    return ti.cast(wide_product(ti.cast(value, ti.f64), weight, zero), ti.f32)


@ti.kernel
def _blend(
    found: i32_2,
    bins: i32_1,
    maps: i32_3,
    shares: f64_1,
    height: ti.i32,
    zero: ti.i32,
    # outputs
    mixed: i32_2,
    counts: i32_1,
):
    width = shares.shape[0] - height
    for y, x in ti.ndrange(found.shape[0], found.shape[1]):
        py = y + height // 2
        px = x + width // 2
        top = ti.max(py // height - 1, 0)
        bottom = ti.min(py // height, maps.shape[0] - 1)
        left = ti.max(px // width - 1, 0)
        right = ti.min(px // width, maps.shape[1] - 1)
        one = ti.f64(1.0)
        v = shares[py % height]
        u = shares[height + px % width]
        code = bins[found[y, x]]
        total = _share(maps[top, left, code], (one - u) * (one - v), zero)
        total += _share(maps[top, right, code], u * (one - v), zero)
        total += _share(maps[bottom, left, code], (one - u) * v, zero)
        total += _share(maps[bottom, right, code], u * v, zero)
        tone = ti.min(ti.cast(total, ti.i32), TONES - 1)
        mixed[y, x] = tone
        ti.atomic_add(counts[tone], 1)


@primitive
def blend(
    found: np.ndarray,
    bins: np.ndarray,
    maps: np.ndarray,
    shares: np.ndarray,
    height: int,
    mixed: np.ndarray,
    counts: np.ndarray,
) -> None:
    """Mix the tones that the four nearest tiles map a pixel to, and count what comes out.

    `shares` are the weights of the lower tiles for each row of one of that height, then of the
    right ones for each column; one thread a pixel.
    """
    _blend(found, bins, maps, shares, height, 0, mixed, counts)


@ti.kernel
def _look_up(image: f32_2, found: i32_1, table: f32_1, zero: ti.i32, out: f32_2):
    for i in range(out.shape[0]):
        new = table[found[i]]
        value = image[i, 0]
        for c in range(1, out.shape[1]):
            value = ti.max(value, image[i, c])
        for c in range(out.shape[1]):
            if out.shape[1] > 1 and value > 0.0:
                out[i, c] = quotient(product(image[i, c], new, zero), value, zero)
            else:
                out[i, c] = new


@primitive
def look_up(image: np.ndarray, found: np.ndarray, table: np.ndarray, out: np.ndarray) -> None:
    """Replace the largest channel of (N, C) values by the table's, and scale the others with it.

    One thread a pixel.
    """
    _look_up(image, found, table, 0, out)


@ti.func
def _place(steps: f64_1, value: ti.f64, count: ti.i32) -> ti.i32:
    """Return the last of the first `count` rising steps that is not above a value, or the first."""
    low = 0
    high = count
    while high - low > 1:
        middle = (low + high) // 2
        if value >= steps[middle]:
            low = middle
        else:
            high = middle
    return low


@ti.kernel
def _count(image: f32_1, edges: f64_1, counts: i32_1):
    for i in range(image.shape[0]):
        low = _place(edges, ti.cast(image[i], ti.f64), counts.shape[0])
        ti.atomic_add(counts[low], 1)


@primitive
def count(image: np.ndarray, edges: np.ndarray, counts: np.ndarray) -> None:
    """Count the values in bins between edges; the last edge belongs to the last bin.

    One thread a value.
    """
    _count(image, edges, counts)


@ti.kernel
def _curve(image: f32_1, centres: f64_1, heights: f64_1, slopes: f64_1, zero: ti.i32, out: f32_1):
    count = centres.shape[0]
    for i in range(out.shape[0]):
        value = ti.math.clamp(ti.cast(image[i], ti.f64), centres[0], centres[count - 1])
        low = _place(centres, value, count - 1)
        rise = wide_product(slopes[low], value - centres[low], zero)
        out[i] = ti.cast(heights[low] + rise, ti.f32)


@primitive
def curve(
    image: np.ndarray,
    centres: np.ndarray,
    heights: np.ndarray,
    slopes: np.ndarray,
    out: np.ndarray,
) -> None:
    """Read a broken line through (centre, height) with these slopes at each value, in float64.

    One thread a value.
    """
    _curve(image, centres, heights, slopes, 0, out)
