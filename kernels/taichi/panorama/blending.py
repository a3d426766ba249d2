"""Multi-band blending: Laplacian bands of images and their weighted mean, in Taichi.

A band is the detail that smoothing removes: an image minus its enlarged half-size image [P. Burt
and E. Adelson, "A multiresolution spline with application to image mosaics", ACM Transactions on
Graphics 2(4), 1983]. A band of the panorama is the weighted mean of this band over all images,
``sum w_i b_i / sum w_i``. The weights w_i are the masks of the images, smoothed as often as the
images. Colours are planes (C, H, W). One thread computes one pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.panorama import BLEND_TAPS, Part
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient

any_3 = ti.types.ndarray(ndim=3)  # u8 or f32
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@primitive
def reduce(src: np.ndarray, dst: np.ndarray) -> None:
    """Smooth planes and keep every second row and column; one thread a pixel of the result."""
    _reduce(src, 0, dst)


@primitive
def add_band(
    fine: np.ndarray,
    coarse: np.ndarray,
    last: int,
    top: int,
    left: int,
    totals: np.ndarray,
    sums: np.ndarray,
) -> None:
    """Add weights times (fine - enlarged coarse) to a part of the totals; one thread a pixel.

    The plane of `fine` behind the colours has the weights, which are added to the sums. The `last`
    band is the fine image itself.
    """
    _add_band(fine, coarse, last, top, left, 0, totals, sums)


@primitive
def collapse(sums: np.ndarray, coarse: np.ndarray, last: int, values: np.ndarray) -> None:
    """Divide totals by their sums; add the enlarged coarse image, except in the `last` band.

    `values` holds the totals before and the image afterwards. One thread a pixel.
    """
    _collapse(sums, coarse, last, 0, values)


@primitive
def finish(
    values: np.ndarray,
    labels: np.ndarray,
    high: float,
    part: Part,
    image: np.ndarray,
    mask: np.ndarray,
) -> None:
    """Write a part of a tile to an image; one thread a pixel.

    A positive `high` is the largest value, and values are rounded. Pixels without an image are 0.
    """
    byte = image.dtype == np.uint8
    _finish(values, labels, high, *part, byte, image, mask)


@ti.kernel
def _reduce(
    src: f32_3,  # (C, H, W)
    zero: ti.i32,
    # outputs
    dst: f32_3,  # (C, H / 2, W / 2)
):
    for c, i, j in dst:
        total = 0.0
        for s in ti.static(range(5)):
            y = ti.max(0, ti.min(src.shape[1] - 1, 2 * i + s - 2))
            along = 0.0
            for t in ti.static(range(5)):
                x = ti.max(0, ti.min(src.shape[2] - 1, 2 * j + t - 2))
                along += product(BLEND_TAPS[t], src[c, y, x], zero)
            total += product(BLEND_TAPS[s], along, zero)
        dst[c, i, j] = total


@ti.func
def _between(before: ti.f32, here: ti.f32, after: ti.f32, odd: ti.i32, zero: ti.i32) -> ti.f32:
    """Return a value at twice the size: of a pixel, or half way to the next."""
    value = 0.5 * here + 0.5 * after
    if odd == 0:
        value = 0.125 * before + product(0.75, here, zero) + 0.125 * after
    return value


@ti.func
def _along_row(coarse: ti.template(), c: ti.i32, i: ti.i32, x: ti.i32, zero: ti.i32) -> ti.f32:
    """Return column x of row i of the coarse image, enlarged along the row."""
    j = x // 2
    before = coarse[c, i, ti.max(j - 1, 0)]
    after = coarse[c, i, ti.min(j + 1, coarse.shape[2] - 1)]
    return _between(before, coarse[c, i, j], after, x - 2 * j, zero)


@ti.func
def _enlarged(coarse: ti.template(), c: ti.i32, y: ti.i32, x: ti.i32, zero: ti.i32) -> ti.f32:
    """Return a pixel of the coarse image at twice its size."""
    i = y // 2
    before = _along_row(coarse, c, ti.max(i - 1, 0), x, zero)
    here = _along_row(coarse, c, i, x, zero)
    after = _along_row(coarse, c, ti.min(i + 1, coarse.shape[1] - 1), x, zero)
    return _between(before, here, after, y - 2 * i, zero)


@ti.kernel
def _add_band(
    fine: f32_3,  # (C + 1, h, w)
    coarse: f32_3,  # (C + 1, h / 2, w / 2)
    last: ti.i32,
    top: ti.i32,
    left: ti.i32,
    zero: ti.i32,
    # outputs
    totals: f32_3,  # (C, H, W)
    sums: f32_2,  # (H, W)
):
    for i, j in ti.ndrange(fine.shape[1], fine.shape[2]):
        weight = fine[totals.shape[0], i, j]
        if weight > 0.0:
            sums[top + i, left + j] = sums[top + i, left + j] + weight
            for c in range(totals.shape[0]):
                band = fine[c, i, j]
                if last == 0:
                    band = band - _enlarged(coarse, c, i, j, zero)
                old = totals[c, top + i, left + j]
                totals[c, top + i, left + j] = old + product(weight, band, zero)


@ti.kernel
def _collapse(
    sums: f32_2,  # (H, W)
    coarse: f32_3,  # (C, H / 2, W / 2)
    last: ti.i32,
    zero: ti.i32,
    # outputs
    values: f32_3,  # (C, H, W)
):
    for i, j in ti.ndrange(sums.shape[0], sums.shape[1]):
        weight = sums[i, j]
        for c in range(values.shape[0]):
            value = 0.0
            if weight > 0.0:
                value = quotient(values[c, i, j], weight, zero)
            if last == 0:
                value = value + _enlarged(coarse, c, i, j, zero)
            values[c, i, j] = value


@ti.kernel
def _finish(
    values: f32_3,  # (C, h, w)
    labels: i32_2,  # (h, w)
    high: ti.f32,
    top: ti.i32,
    left: ti.i32,
    row: ti.i32,
    column: ti.i32,
    rows: ti.i32,
    columns: ti.i32,
    byte: ti.template(),
    # outputs
    image: any_3,  # (H, W, C)
    mask: u8_2,  # (H, W)
):
    for i, j in ti.ndrange(rows, columns):
        there = labels[top + i, left + j] >= 0
        mask[row + i, column + j] = ti.cast(ti.select(there, 1, 0), ti.u8)
        for c in range(image.shape[2]):
            value = 0.0
            if there:
                value = values[c, top + i, left + j]
                if high > 0.0:
                    value = ti.floor(ti.max(ti.min(value, high), 0.0) + 0.5)
            if ti.static(byte):
                image[row + i, column + j, c] = ti.cast(value, ti.u8)
            else:
                image[row + i, column + j, c] = value
