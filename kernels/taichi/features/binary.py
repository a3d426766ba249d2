"""FAST corners and binary descriptors, in Taichi.

A pixel is a corner if 9 neighbouring pixels of the 16 on a circle around it are all brighter than
it by more than a threshold t, or all darker [E. Rosten and T. Drummond, "Machine learning for
high-speed corner detection", ECCV 2006]. Its score is the largest such t. A corner is kept if no
pixel of the eight around it has a larger score; of equal ones the first in raster order is kept.
Corners are ranked by Harris' measure (corners.py) of the square around them.

A smaller size of an image weighs the bytes of neighbouring rows, then of neighbouring columns, by
integers whose sum is 128; each time the result is rounded to a byte, halves up.

The direction of a corner is ``atan2(sum y I, sum x I)`` over a disc, with y and x from its middle.
A bit of its descriptor is ``S(p_k) < S(q_k)``, where S is the image smoothed by integer weights and
rounded, halves up, as by ``cv2.GaussianBlur``, and the 256 pairs (p_k, q_k) are turned with the
corner in 64 steps [E. Rublee, V. Rabaud, K. Konolige and
G. Bradski, "ORB: an efficient alternative to SIFT or SURF", ICCV 2011]. All decisions are in
integers, except for the angle. One thread takes a pixel, or a corner.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import taichi as ti

from cvkern.kernels.codes.features import (
    BLUR,
    BLUR_TAPS,
    CIRCLE,
    DISC,
    PAIRS,
    PATTERN_PITCH,
    SHARES,
    TURNS,
    TURNS_PER_RADIAN,
    WORD,
)
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._polar import gradient_angle
from cvkern.kernels.taichi._rounding import product

from ._marks import count_marks, list_marks, rows_of

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
i64_1 = ti.types.ndarray(dtype=ti.i64, ndim=1)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
u16_2 = ti.types.ndarray(dtype=ti.u16, ndim=2)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i16_3 = ti.types.ndarray(dtype=ti.i16, ndim=3)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)


@primitive
def round_values(src: np.ndarray, dst: np.ndarray) -> None:
    """Bytes of values: rounded and cut off; one thread a pixel."""
    _round(src, dst)


@ti.kernel
def _round(
    src: f32_2,
    # outputs
    dst: u8_2,
):
    for y, x in dst:
        dst[y, x] = ti.cast(ti.floor(ti.max(ti.min(src[y, x], 255.0), 0.0) + 0.5), ti.u8)


@primitive
def shrink(images: Sequence[np.ndarray], starts: np.ndarray, weights: np.ndarray) -> None:
    """Make images 1, 2, ..., each of the one before, down the rows, then along them.

    The starts and integer weights of the rows and columns of all images follow each other. One
    thread an element and pass.
    """
    first = 0
    for src, dst in pairwise(images):
        middle, last = first + dst.shape[0], first + sum(dst.shape)
        lines = scratch((dst.shape[0], src.shape[1]), np.uint8)
        _shrink(src, starts[first:middle], weights[first:middle], True, lines)
        _shrink(lines, starts[middle:last], weights[middle:last], False, dst)
        first = last


@ti.kernel
def _shrink(
    src: u8_2,
    starts: i32_1,  # (m,)
    weights: u8_2,  # (m, T)
    down: ti.template(),
    # outputs
    dst: u8_2,
):
    for y, x in dst:
        k = y if ti.static(down) else x
        total = SHARES // 2
        for t in range(weights.shape[1]):
            w = ti.cast(weights[k, t], ti.i32)
            if w != 0:
                i = starts[k] + t
                total += w * ti.cast(src[i, x] if ti.static(down) else src[y, i], ti.i32)
        dst[y, x] = ti.cast(total // SHARES, ti.u8)


@primitive
def mark_corners(
    images: Sequence[np.ndarray],
    threshold: int,
    margin: int,
    words: np.ndarray,
    ends: np.ndarray,
) -> None:
    """Mark FAST corners of 9 pixels of 16 that score most of 3 x 3, of equal ones the first.

    A bit a pixel of all sizes of the image, rows of words one after the other, and their number up
    to the end of each row.
    """
    for src, (marks, _) in zip(images, rows_of(images, words), strict=True):
        scores = scratch(src.shape, np.uint8)
        _score(src, threshold, margin, scores)
        _mark(scores, marks)
    count_marks(images, words, ends)


@ti.kernel
def _score(
    src: u8_2,
    threshold: ti.i32,
    margin: ti.i32,
    # outputs
    scores: u8_2,
):
    for y, x in src:
        best = 0
        if y >= margin and y < src.shape[0] - margin and x >= margin and x < src.shape[1] - margin:
            v = ti.cast(src[y, x], ti.i32)
            for k in ti.static(range(16)):
                # On CUDA, Taichi 1.7 compiles such chains of ti.min and ti.max wrongly.
                lowest = 255
                highest = -255
                for n in ti.static(range(9)):
                    i, j = ti.static(CIRCLE[(k + n) % 16])
                    d = ti.cast(src[y + i, x + j], ti.i32) - v
                    if d < lowest:
                        lowest = d
                    if d > highest:
                        highest = d
                if lowest > best:
                    best = lowest
                if -highest > best:
                    best = -highest
        if best <= threshold:
            best = 0
        scores[y, x] = ti.cast(best, ti.u8)


@ti.func
def _is_largest(scores: ti.template(), y: ti.i32, x: ti.i32) -> ti.i32:
    """Compare a score with the eight around it."""
    v = ti.cast(scores[y, x], ti.i32)
    found = 1 if v > 0 else 0
    for i, j in ti.static(ti.ndrange((-1, 2), (-1, 2))):
        near = ti.cast(scores[y + i, x + j], ti.i32)
        if ti.static(i < 0 or (i == 0 and j < 0)):
            if near >= v:
                found = 0
        elif near > v:
            found = 0
    return found


@ti.kernel
def _mark(
    scores: u8_2,
    # outputs
    words: i32_3,  # (1, H, K)
):
    for s, y, k in words:
        word = 0
        if y > 0 and y < scores.shape[0] - 1:
            for bit in range(WORD):
                x = k * WORD + bit
                if x > 0 and x < scores.shape[1] - 1:
                    word = word | (_is_largest(scores, y, x) << bit)
        words[s, y, k] = word


@primitive
def list_corners(
    images: Sequence[np.ndarray],
    words: np.ndarray,
    ends: np.ndarray,
    cells: np.ndarray,
    responses: np.ndarray,
) -> None:
    """List size, 1, row and column of the N marks, in this order, with Harris' measure of each.

    It is that over 7 x 7 pixels, times 25, as an integer.
    """
    list_marks(images, words, ends, cells)
    for n, src in enumerate(images):
        _weigh(src, n, cells, responses)


@ti.func
def _at(src: ti.template(), y: ti.i32, x: ti.i32) -> ti.i32:
    """Return a pixel."""
    return ti.cast(src[y, x], ti.i32)


@ti.kernel
def _weigh(
    src: u8_2,
    image: ti.i32,
    cells: i32_2,  # (N, 4)
    # outputs
    responses: i64_1,
):
    for n in responses:
        if cells[n, 0] != image:
            continue
        row = cells[n, 2]
        column = cells[n, 3]
        yy = 0
        xx = 0
        xy = 0
        for y in range(row - 3, row + 4):
            for x in range(column - 3, column + 4):
                nw = _at(src, y - 1, x - 1)
                ne = _at(src, y - 1, x + 1)
                sw = _at(src, y + 1, x - 1)
                se = _at(src, y + 1, x + 1)
                gy = sw - nw + se - ne + 2 * (_at(src, y + 1, x) - _at(src, y - 1, x))
                gx = ne - nw + se - sw + 2 * (_at(src, y, x + 1) - _at(src, y, x - 1))
                yy += gy * gy
                xx += gx * gx
                xy += gx * gy
        wide = ti.cast(yy, ti.i64) + xx
        det = ti.cast(yy, ti.i64) * xx - ti.cast(xy, ti.i64) * xy
        responses[n] = 25 * det - wide * wide


@primitive
def describe_corners(
    images: Sequence[np.ndarray],
    cells: np.ndarray,
    pattern: np.ndarray,
    upright: int,
    angles: np.ndarray,
    descriptors: np.ndarray,
) -> None:
    """Direction by the moments of a disc, bits by comparing pairs of smoothed pixels.

    Cells are as `list_corners` lists them. A thread a point.
    """
    for n, src in enumerate(images):
        lines = scratch(src.shape, np.uint16)
        smooth = scratch(src.shape, np.uint8)
        _blur_down(src, lines)
        _blur_along(lines, smooth)
        _describe(src, smooth, n, cells, pattern, upright, 0, angles, descriptors)


@ti.kernel
def _blur_down(
    src: u8_2,
    # outputs
    lines: u16_2,
):
    for y, x in src:
        if y >= BLUR and y < src.shape[0] - BLUR:
            total = 0
            for t in ti.static(range(2 * BLUR + 1)):
                total += BLUR_TAPS[t] * ti.cast(src[y + t - BLUR, x], ti.i32)
            lines[y, x] = ti.cast(total, ti.u16)


@ti.kernel
def _blur_along(
    lines: u16_2,
    # outputs
    smooth: u8_2,
):
    for y, x in lines:
        if x >= BLUR and x < lines.shape[1] - BLUR:
            total = 1 << 15
            for t in ti.static(range(2 * BLUR + 1)):
                total += BLUR_TAPS[t] * ti.cast(lines[y, x + t - BLUR], ti.i32)
            smooth[y, x] = ti.cast(total >> 16, ti.u8)


@ti.func
def _compared(smooth: ti.template(), y: ti.i32, x: ti.i32, place: ti.i32) -> ti.i32:
    """Return the pixel at a place of the pattern, from its middle."""
    row = (place + PATTERN_PITCH // 2) >> ti.static(PATTERN_PITCH.bit_length() - 1)
    return ti.cast(smooth[y + row, x + place - PATTERN_PITCH * row], ti.i32)


@ti.kernel
def _describe(
    src: u8_2,
    smooth: u8_2,
    image: ti.i32,
    cells: i32_2,  # (N, 4)
    pattern: i16_3,  # (TURNS, PAIRS, 2)
    upright: ti.i32,
    zero: ti.i32,
    # outputs
    angles: f32_1,
    descriptors: u8_2,
):
    for n in angles:
        if cells[n, 0] != image:
            continue
        cy = cells[n, 2]
        cx = cells[n, 3]
        angle = 0.0
        turn = 0
        if upright == 0:
            down = 0
            along = 0
            for i in range(-DISC, DISC + 1):
                for j in range(-DISC, DISC + 1):
                    if i * i + j * j <= DISC * (DISC + 1):
                        v = ti.cast(src[cy + i, cx + j], ti.i32)
                        down += i * v
                        along += j * v
            angle = gradient_angle(ti.cast(down, ti.f32), ti.cast(along, ti.f32), zero)
            steps = ti.floor(product(angle, TURNS_PER_RADIAN, zero) + 0.5)
            turn = ti.cast(steps, ti.i32) & (TURNS - 1)
        angles[n] = angle
        for b in range(PAIRS // 8):
            bits = 0
            for k in range(8):
                p = 8 * b + k
                one = _compared(smooth, cy, cx, ti.cast(pattern[turn, p, 0], ti.i32))
                other = _compared(smooth, cy, cx, ti.cast(pattern[turn, p, 1], ti.i32))
                if one < other:
                    bits = bits | (1 << k)
            descriptors[n, b] = ti.cast(bits, ti.u8)
