"""The matches of pairs of images in an order of their own, in Taichi.

A fit must not depend on the order in which matches come. So they are sorted by a hash of 46 bits of
their coordinates, mixed as by splitmix64; two different matches of one hash are in the order in
which they came. The first matches are then as good as drawn by lot. Equal matches count once, and
those that are not finite are left out. One thread takes a pair, and sorts by Shell's method.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.geometry import LANES, MAX_MATCHES
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._rounding import wide_product

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
u64_1 = ti.types.ndarray(dtype=ti.u64, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
MULTIPLIER = 0x9E3779B97F4A7C15


@primitive
def sort_matches(
    points0: np.ndarray,
    points1: np.ndarray,
    spans: np.ndarray,
    order: np.ndarray,
    places: np.ndarray,
    counts: np.ndarray,
    boxes: np.ndarray,
) -> None:
    """Sort the finite matches of each pair by a hash of their coordinates, equal ones once.

    `points0` (M, 2) are rows and columns, or (M, 3) x, y and z; `points1` (M, 2). A pair is (its
    first match, their number, its place in the result). `order` (M,) lists its matches, as many as
    `counts` (P,) says, from its first one on; `places` (M,) has their places in the result, or -1;
    `boxes` (P, 2, R) the least and the largest x0, y0, x1, y1, and z0 of a scene.
    """
    keys = scratch((points0.shape[0],), np.uint64)
    _sort(points0, points1, spans, keys, order, places, counts, boxes)


@primitive
def scale_matches(
    points0: np.ndarray,
    points1: np.ndarray,
    spans: np.ndarray,
    order: np.ndarray,
    counts: np.ndarray,
    scales: np.ndarray,
    matches: np.ndarray,
) -> None:
    """Write the sorted matches times a scale less a shift, `scales` (P, 2, R), to (R, T).

    Zeros follow those of a pair, up to a multiple of `LANES`.
    """
    _scale(points0, points1, spans, order, counts, scales, 0, matches)


@ti.func
def _value(points0: ti.template(), points1: ti.template(), i: ti.i32, r: ti.i32) -> ti.f64:
    """Return x0, y0, x1, y1 or z0 of a match; both zeros are one."""
    value = ti.cast(0.0, ti.f64)
    if r == 2 or r == 3:
        value = points1[i, 3 - r]
    elif points0.shape[1] == 3:
        value = points0[i, ti.min(r, 2)]
    else:
        value = points0[i, 1 - r]
    if value == 0.0:
        value = ti.cast(0.0, ti.f64)
    return value


@ti.func
def _differ(points0: ti.template(), points1: ti.template(), i: ti.i32, j: ti.i32) -> ti.i32:
    """Tell whether two matches are different."""
    differs = 0
    for r in range(points0.shape[1] + 2):
        if _value(points0, points1, i, r) != _value(points0, points1, j, r):
            differs = 1
    return differs


@ti.kernel
def _sort(
    points0: f64_2,
    points1: f64_2,
    spans: i32_2,
    keys: u64_1,
    # outputs
    order: i32_1,
    places: i32_1,
    counts: i32_1,
    boxes: f64_3,
):
    for pair in counts:
        first = spans[pair, 0]
        rows = points0.shape[1] + 2
        kept = 0
        for i in range(first, first + spans[pair, 1]):
            finite = 1
            hash = ti.cast(0, ti.u64)
            for r in range(rows):
                value = _value(points0, points1, i, r)
                bits = ti.bit_cast(value, ti.u64)
                exponent = ti.cast(bits >> ti.cast(52, ti.u64), ti.i32) & 2047
                if exponent == 2047:  # infinity, or NaN
                    finite = 0
                hash = (hash ^ bits) * ti.u64(MULTIPLIER)
                hash = hash ^ (hash >> ti.cast(29, ti.u64))
            places[i] = -1
            if finite == 1:
                index = ti.cast(MAX_MATCHES - 1, ti.u64)
                keys[first + kept] = (hash | index) ^ index | ti.cast(i - first, ti.u64)
                kept += 1
        gap = 1
        while gap < kept // 3:
            gap = 3 * gap + 1
        while gap > 0:
            for i in range(gap, kept):
                key = keys[first + i]
                j = i
                while j >= gap and keys[first + ti.max(j - gap, 0)] > key:
                    keys[first + j] = keys[first + j - gap]
                    j -= gap
                keys[first + j] = key
            gap = gap // 3
        for side in range(2):
            for r in range(rows):
                boxes[pair, side, r] = 0.0
        number = 0
        before = -1
        for k in range(kept):
            index = ti.cast(MAX_MATCHES - 1, ti.u64)
            i = ti.cast(keys[first + k] & index, ti.i32)
            fresh = 1
            if k > 0:
                if (keys[first + k] | index) == (keys[first + k - 1] | index):
                    fresh = _differ(points0, points1, first + i, first + before)
            before = i
            if fresh == 1:
                order[first + number] = i
                for r in range(rows):
                    value = _value(points0, points1, first + i, r)
                    if number == 0 or value < boxes[pair, 0, r]:
                        boxes[pair, 0, r] = value
                    if number == 0 or value > boxes[pair, 1, r]:
                        boxes[pair, 1, r] = value
                number += 1
            places[first + i] = spans[pair, 2] + number - 1
        counts[pair] = number


@ti.kernel
def _scale(
    points0: f64_2,
    points1: f64_2,
    spans: i32_2,
    order: i32_1,
    counts: i32_1,
    scales: f64_3,
    zero: ti.i32,
    # outputs
    matches: f32_2,
):
    for pair in counts:
        first = spans[pair, 0]
        for k in range((spans[pair, 1] + LANES - 1) // LANES * LANES):
            for r in range(matches.shape[0]):
                value = ti.cast(0.0, ti.f64)
                if k < counts[pair]:
                    value = _value(points0, points1, first + order[first + k], r)
                    value = wide_product(value, scales[pair, 0, r], zero) - scales[pair, 1, r]
                matches[r, spans[pair, 2] + k] = ti.cast(value, ti.f32)
