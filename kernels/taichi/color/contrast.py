"""Histograms and tone curves, in Taichi.

CLAHE [Zuiderveld 1994]: each tile of an image has a histogram, cut off at a limit, whose sums map
its bins to tones. A pixel gets the mean of the tones of the four nearest tiles, weighted by its
distance to their middles. Counters are integers, so they do not depend on the order of the pixels.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.color import LEVELS, SLOTS, TONES
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._order import key_of
from cvkern.kernels.taichi._rounding import product, quotient, wide_product

any_1 = ti.types.ndarray(ndim=1)  # u8 or u16
any_2 = ti.types.ndarray(ndim=2)  # u8, u16, or f32
f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f64_1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
i64_2 = ti.types.ndarray(dtype=ti.i64, ndim=2)
u16_2 = ti.types.ndarray(dtype=ti.u16, ndim=2)


@ti.func
def _largest(image: ti.template(), i: ti.i32) -> ti.f32:
    value = ti.cast(image[i, 0], ti.f32)
    for c in range(1, image.shape[1]):
        value = ti.max(value, ti.cast(image[i, c], ti.f32))
    return value


@ti.func
def _nearest(value: ti.f32) -> ti.i32:
    """Return the nearest integer, and of two the even one, as NumPy rounds."""
    whole = ti.cast(value, ti.i32)
    rest = value - ti.cast(whole, ti.f32)
    if rest > 0.5 or (rest == 0.5 and whole % 2 == 1):
        whole += 1
    return whole


@ti.kernel
def _levels(image: any_2, scale: ti.f32, zero: ti.i32, found: any_1):
    for i in range(found.shape[0]):
        value = product(_largest(image, i), scale, zero)
        found[i] = _nearest(ti.math.clamp(value, 0.0, float(LEVELS - 1)))


@primitive
def levels(image: np.ndarray, scale: float, found: np.ndarray) -> None:
    """Write the largest channel of (N, C) values, C 1 or 3; floats are scaled and rounded.

    One thread a pixel.
    """
    _levels(image, scale, 0, found)


@ti.kernel
def _count_levels(found: any_1, counts: i32_1):
    for i in range(found.shape[0]):
        ti.atomic_add(counts[ti.cast(found[i], ti.i32)], 1)


@primitive
def count_levels(found: np.ndarray, counts: np.ndarray) -> None:
    """Count how often each level occurs; one thread a pixel."""
    _count_levels(found, counts)


@ti.kernel
def _extent(found: any_1, ends: i32_1):
    for i in range(found.shape[0]):
        ti.atomic_min(ends[0], ti.cast(found[i], ti.i32))
        ti.atomic_max(ends[1], ti.cast(found[i], ti.i32))


@primitive
def extent(found: np.ndarray, ends: np.ndarray) -> None:
    """Find the smallest and the largest level; `ends` must begin as (2^16, -1).

    One thread a pixel.
    """
    _extent(found, ends)


@ti.kernel
def _survey(image: f32_1, keys: i64_2):
    for i in range(image.shape[0]):
        value = image[i]
        if ti.abs(value) < ti.math.inf:
            key = key_of(value)
            ti.atomic_max(keys[i % SLOTS, 0], ti.i64(2**32) - key)
            ti.atomic_max(keys[i % SLOTS, 1], key)
        else:
            ti.atomic_max(keys[i % SLOTS, 2], ti.i64(1))


@primitive
def survey(image: np.ndarray, keys: np.ndarray) -> None:
    """Find both ends of (N,) finite values, and whether there are others: keys (SLOTS, 3).

    Keys are those of `key_of`; that of the least is taken off 2^32, so that all are maxima. The
    last is 1 where a value is not finite. One thread a value.
    """
    _survey(image, keys)


@ti.kernel
def _tiles(found: any_2, bins: i32_1, rows: i32_1, columns: i32_1, counts: i32_3):
    height = rows.shape[0] // counts.shape[0]
    width = columns.shape[0] // counts.shape[1]
    for y, x in ti.ndrange(rows.shape[0], columns.shape[0]):
        code = bins[ti.cast(found[rows[y], columns[x]], ti.i32)]
        ti.atomic_add(counts[y // height, x // width, code], 1)


@primitive
def tiles(
    found: np.ndarray, bins: np.ndarray, rows: np.ndarray, columns: np.ndarray, counts: np.ndarray
) -> None:
    """Count (R, C, B) the bins of levels in tiles, whose pixels `rows` and `columns` name.

    One thread a pixel of a tile.
    """
    _tiles(found, bins, rows, columns, counts)


@ti.kernel
def _tone_maps(limit: ti.i32, scale: ti.f64, counts: i32_2, maps: i32_2):
    for t in range(counts.shape[0]):
        length = counts.shape[1]
        left = 0
        for b in range(length):
            left += ti.max(counts[t, b] - limit, 0)
        share = left // length
        free = 0
        for b in range(length):
            value = ti.min(counts[t, b], limit)
            if value < limit - share:
                value += share
                left -= share
            if limit - share <= value < limit:
                left -= limit - value
                value = limit
            if value < limit:
                free += 1
            counts[t, b] = value
        start = 0
        while left > 0 and free > 0:
            step = ti.max(free // left, 1)
            for i in range((length - start + step - 1) // step):
                b = start + i * step
                if counts[t, b] < limit:
                    counts[t, b] += 1
                    left -= 1
                    if counts[t, b] == limit:
                        free -= 1
            start = (start + 1) % length
        total = 0
        for b in range(length):
            total += counts[t, b]
            maps[t, b] = ti.min(ti.cast(ti.cast(total, ti.f64) * scale, ti.i32), TONES - 1)


@primitive
def tone_maps(counts: np.ndarray, limit: int, scale: float, maps: np.ndarray) -> None:
    """Cut histograms (T, B) off at a limit, share out the excess, and scale their sums.

    All bins get an equal share first, and those that it brings near the limit are filled. The rest
    goes to bins a step apart, one each, from the first on, then from the second: as long as one is
    free, a cycle over all starts fills at least one place. One thread a tile.
    """
    _tone_maps(limit, scale, counts, maps)


@ti.func
def _share(value: ti.i32, weight: ti.f64, zero: ti.i32) -> ti.f32:
    return ti.cast(wide_product(ti.cast(value, ti.f64), weight, zero), ti.f32)


@ti.kernel
def _blend(
    found: any_2,
    bins: i32_1,
    maps: i32_3,
    shares: f64_1,
    height: ti.i32,
    zero: ti.i32,
    # outputs
    mixed: u16_2,
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
        code = bins[ti.cast(found[y, x], ti.i32)]
        total = _share(maps[top, left, code], (one - u) * (one - v), zero)
        total += _share(maps[top, right, code], u * (one - v), zero)
        total += _share(maps[bottom, left, code], (one - u) * v, zero)
        total += _share(maps[bottom, right, code], u * v, zero)
        mixed[y, x] = ti.cast(ti.min(ti.cast(total, ti.i32), TONES - 1), ti.u16)


@primitive
def blend(
    found: np.ndarray,
    bins: np.ndarray,
    maps: np.ndarray,
    shares: np.ndarray,
    height: int,
    mixed: np.ndarray,
) -> None:
    """Mix the tones that the four nearest tiles map a pixel to.

    `shares` are the weights of the lower tiles for each row of one of that height, then of the
    right ones for each column; one thread a pixel.
    """
    _blend(found, bins, maps, shares, height, 0, mixed)


@ti.kernel
def _read_table(found: any_1, table: any_1, out: any_2):
    for i in range(out.shape[0]):
        out[i, 0] = table[ti.cast(found[i], ti.i32)]


@ti.kernel
def _scale(image: any_2, found: any_1, table: f32_1, whole: ti.i32, zero: ti.i32, out: any_2):
    for i in range(out.shape[0]):
        new = table[ti.cast(found[i], ti.i32)]
        most = _largest(image, i)
        for c in range(3):
            value = new
            if most > 0.0:
                value = quotient(product(ti.cast(image[i, c], ti.f32), new, zero), most, zero)
            if whole:
                value = ti.cast(_nearest(value), ti.f32)
            out[i, c] = value


@primitive
def look_up(image: np.ndarray, found: np.ndarray, table: np.ndarray, out: np.ndarray) -> None:
    """Replace the largest channel of (N, C) values by the table's, and scale the others with it.

    C is 1 or 3. Colours as bytes are rounded, and the table holds floats; else its type is theirs.
    One thread a pixel.
    """
    if out.shape[1] == 1:
        _read_table(found, table, out)
    else:
        _scale(image, found, table, int(out.dtype == np.uint8), 0, out)


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
