"""Extrema of a scale space in Taichi.

Level s of an octave is the image smoothed by a Gaussian of ``sigma_0 2^(s / S)``. Their differences
``D_s = L_(s+1) - L_s`` have extrema at blobs, in place and in scale: pixels whose difference
exceeds those of the 26 neighbours on three levels, or is below them [D. G. Lowe, IJCV 60(2),
2004]. A fit (refinement.py) moves an extremum to the pixel where a paraboloid has its own, and sets
a bit there; then the bits of each row are counted and listed, so that the points have the order of
their places. One thread takes a pixel, or a row of bits.
"""

from collections.abc import Sequence

import numpy as np
import taichi as ti

from cvkern.kernels.codes.features import GRAY, MOST_GRAY, WORD, Limits
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._rounding import product
from cvkern.kernels.taichi.features._marks import count_marks, list_marks, rows_of

from ._paraboloid import fit

any_3 = ti.types.ndarray(ndim=3)  # u8 or f32
f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)


@primitive
def prepare(src: np.ndarray, scale: float, dst: np.ndarray) -> None:
    """Grey values of bytes or floats, times `scale`; one thread a pixel."""
    _prepare(src, scale, 0, dst)


@ti.kernel
def _prepare(
    src: any_3,  # (H, W, C)
    scale: ti.f32,
    zero: ti.i32,
    # outputs
    dst: f32_2,
):
    for y, x in dst:
        v = ti.cast(src[y, x, 0], ti.f32)
        if src.shape[2] > 1:
            v = product(GRAY[0], v, zero) + product(GRAY[1], ti.cast(src[y, x, 1], ti.f32), zero)
            v = v + product(GRAY[2], ti.cast(src[y, x, 2], ti.f32), zero)
        v = v * scale
        dst[y, x] = v if ti.abs(v) <= MOST_GRAY else 0.0  # NaN as well


@primitive
def double(src: np.ndarray, dst: np.ndarray) -> None:
    """Twice the size, by means between the pixels; one thread a pixel."""
    _double(src, dst)


@ti.kernel
def _double(
    src: f32_2,  # (H, W)
    # outputs
    dst: f32_2,  # (2 H, 2 W)
):
    for v, u in dst:
        y = v // 2
        x = u // 2
        below = y
        right = x
        if v % 2 == 1:
            below = ti.min(y + 1, src.shape[0] - 1)
        if u % 2 == 1:
            right = ti.min(x + 1, src.shape[1] - 1)
        left = 0.5 * (src[y, x] + src[below, x])
        dst[v, u] = 0.5 * (left + 0.5 * (src[y, right] + src[below, right]))


@primitive
def fill_octaves(
    src: np.ndarray, taps: Sequence[np.ndarray], octaves: Sequence[np.ndarray]
) -> None:
    """Smooth an image to the first level of the first octave, and each level to the next one.

    An octave begins with every second pixel of the larger one's level that is third from its end.
    Symmetric taps are applied down the rows and then along the columns, mirrored: the first ones
    to the image, the others to the levels. A sum begins with the middle, and adds pairs of elements
    from the inner ones outwards. One thread a pixel and pass.
    """
    for o, octave in enumerate(octaves):
        if o:
            _halve(octaves[o - 1][-3], octave[0])
        else:
            _smooth(src, taps[0], octave[0])
        for i in range(1, octave.shape[0]):
            _smooth(octave[i - 1], taps[i], octave[i])


def _smooth(src: np.ndarray, taps: np.ndarray, dst: np.ndarray) -> None:
    middle = scratch(src.shape, np.float32)
    _smooth_down(src, taps, 0, middle)
    _smooth_along(middle, taps, 0, dst)


@ti.kernel
def _smooth_down(
    src: f32_2,
    taps: f32_1,
    zero: ti.i32,
    # outputs
    dst: f32_2,
):
    reach = taps.shape[0] // 2
    for y, x in dst:
        total = product(taps[reach], src[y, x], zero)
        for t in range(1, reach + 1):
            pair = src[_mirrored(y - t, src.shape[0]), x] + src[_mirrored(y + t, src.shape[0]), x]
            total = total + product(taps[reach + t], pair, zero)
        dst[y, x] = total


@ti.kernel
def _smooth_along(
    src: f32_2,
    taps: f32_1,
    zero: ti.i32,
    # outputs
    dst: f32_2,
):
    reach = taps.shape[0] // 2
    for y, x in dst:
        total = product(taps[reach], src[y, x], zero)
        for t in range(1, reach + 1):
            pair = src[y, _mirrored(x - t, src.shape[1])] + src[y, _mirrored(x + t, src.shape[1])]
            total = total + product(taps[reach + t], pair, zero)
        dst[y, x] = total


@ti.func
def _mirrored(i: ti.i32, size: ti.i32) -> ti.i32:
    """Mirror an index about the outermost pixels."""
    k = ti.abs(i)
    if size == 1:
        k = 0
    else:
        k = k % (2 * (size - 1))
        k = ti.min(k, 2 * (size - 1) - k)
    return k


@ti.kernel
def _halve(
    src: f32_2,
    # outputs
    dst: f32_2,
):
    for y, x in dst:
        dst[y, x] = src[2 * y, 2 * x]


@primitive
def mark_keypoints(
    octaves: Sequence[np.ndarray],
    limits: Limits,
    margin: int,
    words: np.ndarray,
    ends: np.ndarray,
) -> None:
    """Mark the pixels to which fits move the extrema among 26 neighbours, if they are kept.

    A bit a pixel of the inner levels of all octaves, rows of words one after the other, and their
    number up to the end of each row. Extrema that move to one pixel are one. One thread a word.
    """
    extrema = scratch(words.shape, np.int32)
    both = zip(rows_of(octaves, extrema), rows_of(octaves, words), strict=True)
    for levels, ((found, _), (marks, _)) in zip(octaves, both, strict=True):
        _mark(levels, limits.threshold, margin, found)
        _clear(marks)
        _move(levels, limits.contrast, limits.edge, margin, 0, found, marks)
    count_marks(octaves, words, ends)


@ti.kernel
def _clear(
    words: i32_3,
):
    for s, y, k in words:
        words[s, y, k] = 0


@ti.kernel
def _move(
    levels: f32_3,  # (L, H, W)
    contrast: ti.f32,
    edge: ti.f32,
    margin: ti.i32,
    zero: ti.i32,
    extrema: i32_3,  # (L - 3, H, ceil(W / 32))
    # outputs
    words: i32_3,
):
    for s, y, k in extrema:
        if extrema[s, y, k] != 0:
            for bit in range(WORD):
                if (extrema[s, y, k] >> bit) & 1 == 1:
                    end = fit(levels, s + 1, y, k * WORD + bit, contrast, edge, margin, zero)
                    if end.kept == 1:
                        bits = 1 << (end.x % WORD)
                        ti.atomic_or(words[end.s - 1, end.y, end.x // WORD], bits)


@ti.func
def _is_extreme(levels: ti.template(), s: ti.i32, y: ti.i32, x: ti.i32, least: ti.f32) -> ti.i32:
    """Compare difference `s` + 1 at a pixel with the 26 around it."""
    v = levels[s + 2, y, x] - levels[s + 1, y, x]
    found = 1 if ti.abs(v) > least else 0
    if found == 1:
        for n in range(27):
            l = s + n // 9
            i = y + n // 3 % 3 - 1
            j = x + n % 3 - 1
            near = levels[l + 1, i, j] - levels[l, i, j]
            if (v > 0.0 and near > v) or (v < 0.0 and near < v):
                found = 0
                break
    return found


@ti.kernel
def _mark(
    levels: f32_3,  # (L, H, W)
    threshold: ti.f32,
    margin: ti.i32,
    # outputs
    words: i32_3,  # (L - 3, H, ceil(W / 32))
):
    for s, y, k in words:
        word = 0
        if y >= margin and y < levels.shape[1] - margin:
            for bit in range(WORD):
                x = k * WORD + bit
                if x >= margin and x < levels.shape[2] - margin:
                    word = word | (_is_extreme(levels, s, y, x, threshold) << bit)
        words[s, y, k] = word


@primitive
def list_keypoints(
    octaves: Sequence[np.ndarray], words: np.ndarray, ends: np.ndarray, cells: np.ndarray
) -> None:
    """List octave, level, row and column of the N marks, in this order; one thread a row."""
    list_marks(octaves, words, ends, cells)
