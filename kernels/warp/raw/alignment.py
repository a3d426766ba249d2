"""Median threshold bitmaps, in Warp.

Whether a pixel is above the median of its image hardly depends on the exposure [G. Ward, "Fast,
robust image registration for compositing high dynamic range photographs from hand-held exposures",
Journal of Graphics Tools 8(2), 2003]. Grey values are levels of 16 bits between the least and the
largest of an image; all that follows are integers. One thread takes a pixel, or every so many
pixels where these are counted; on the CPU, a slab of them, or one image.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.raw import GREYS, GROUP, MOVES, PARTS
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, slabs
from cvkern.kernels.warp._order import key_of

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

_THREADS = 2**16  # threads of CUDA that count
_PARTS, _TOP, _MOVES = wp.constant(PARTS), wp.constant(GREYS - 1), wp.constant(len(MOVES))
_GROUP = wp.constant(GROUP)
_Each = wp.types.vector(len(MOVES), wp.int32)
_DOWN, _ALONG = (wp.constant(_Each(*steps)) for steps in zip(*MOVES, strict=True))


def mix(frames: wp.array, share: float, grey: wp.array, ends: wp.array) -> None:
    """Write the means of (K, N, C) values, each with its share, and the keys of both ends, (K, 2).

    Keys are those of `key_of`; that of the least is taken off 2^32, so that both are maxima.
    """
    images, pixels = grey.shape
    each = min(_THREADS, pixels) if grey.device.is_cuda else 1
    kernel = _mix(frames.dtype)
    launch_each(kernel, images * each, frames.size, [frames, share, each], [grey, ends])


def grade(grey: wp.array, scales: wp.array, levels: wp.array) -> None:
    """Write the level of each value; `scales` (K, 2) has the least one and the levels a unit."""
    launch_each(_grade, levels.size, 2 * levels.size, [grey, scales], [levels])


def halve(src: wp.array, dst: wp.array) -> None:
    """Write the means of blocks of 2 x 2 pixels, rounded down."""
    launch_each(_halve, dst.size, 4 * dst.size, [src], [dst])


def count(levels: wp.array, counts: wp.array) -> None:
    """Count the pixels (K, N) of each level, (K, GREYS)."""
    images, pixels = levels.shape
    each = min(_THREADS, pixels) if levels.device.is_cuda else 1
    launch_each(_count, images * each, levels.size, [levels, each], [counts])


def medians(counts: wp.array, found: wp.array) -> None:
    """Write the lower median of each image's levels, of which `counts` (K, GREYS) tell."""
    shape = (counts.shape[0], GREYS // GROUP)
    parts = scratch("alignment.parts", shape, wp.int32, counts.device)
    launch_each(_add_up, parts.size, counts.size, [counts], [parts])
    launch_each(_medians, found.size, found.size, [counts, parts], [found])


def split(levels: wp.array, medians: wp.array, noise: int, sides: wp.array) -> None:
    """Write 2 above the median of (K, N) levels, 1 below, 0 within `noise` of it."""
    launch_each(_split, levels.size, levels.size, [levels, medians, noise], [sides])


def compare(sides: wp.array, fixed: int, shifts: wp.array, sums: wp.array) -> None:
    """Count where each image, moved by its shift doubled and one of MOVES, is on the other side.

    The counts of a move are spread over PARTS sums, (K, PARTS, MOVES), which are 0 before.
    """
    images, height, width = sides.shape
    if sides.device.is_cuda:
        threads = min(_THREADS // 4, height * width)
        launch(_compare, (images, threads), [threads, sides, fixed, shifts], [sums])
        return
    count = min(slabs(height, 9 * height * width), PARTS)
    for k, (dy, dx) in enumerate((2 * shifts.numpy()).tolist()):
        launch_slabs(_compare_rows, height, count, [sides, k, fixed, dy, dx], [sums[k]])


def choose(sums: wp.array, height: int, width: int, shifts: wp.array) -> None:
    """Double each shift and add the move with the smallest share of pixels that differ.

    On a tie it is the first of MOVES; without common pixels, none.
    """
    launch_each(_choose, shifts.shape[0], sums.size, [sums, height, width], [shifts])


@_native.func_native("_alignment_cpu.h", MOVES=len(MOVES))
def _differ_row(
    slot: int,
    y: int,
    sides: wp.array3d[wp.uint8],
    k: int,
    fixed: int,
    dy: int,
    dx: int,
    sums: wp.array2d[int],
): ...


@wp.kernel
def _compare_rows(
    slab: int,
    first: int,
    last: int,
    sides: wp.array3d[wp.uint8],
    k: int,
    fixed: int,
    dy: int,
    dx: int,
    # outputs
    sums: wp.array2d[int],
):
    for y in range(first, last):
        _differ_row(slab, y, sides, k, fixed, dy, dx, sums)


@lru_cache
def _mix(scalar: Any) -> wp.Kernel:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def mix_pixels(
        stride: int,
        first: int,
        last: int,
        frames: wp.array3d[scalar],
        share: float,
        each: int,
        # outputs
        grey: wp.array2d[float],
        ends: wp.array2d[wp.int64],
    ):
        for item in range(first + wp.tid(), last, stride):
            k = item // each
            low = wp.int64(0)
            high = wp.int64(0)
            for i in range(item - k * each, grey.shape[1], each):
                total = float(0.0)
                for c in range(frames.shape[2]):
                    v = float(frames[k, i, c])
                    if wp.abs(v) < 1.0e30:
                        total += v
                mean = total * share
                grey[k, i] = mean
                key = key_of(mean)
                low = wp.max(low, wp.int64(4294967296) - key)
                high = wp.max(high, key)
            wp.atomic_max(ends, k, 0, low)
            wp.atomic_max(ends, k, 1, high)

    return mix_pixels


@wp.kernel
def _grade(
    stride: int,
    first: int,
    last: int,
    grey: wp.array2d[float],
    scales: wp.array2d[float],
    # outputs
    levels: wp.array2d[int],
):
    for item in range(first + wp.tid(), last, stride):
        k = item // grey.shape[1]
        i = item - k * grey.shape[1]
        level = int((grey[k, i] - scales[k, 0]) * scales[k, 1])
        levels[k, i] = wp.clamp(level, 0, _TOP)


@wp.kernel
def _halve(
    stride: int,
    first: int,
    last: int,
    src: wp.array3d[int],
    # outputs
    dst: wp.array3d[int],
):
    for item in range(first + wp.tid(), last, stride):
        row = item // dst.shape[2]
        x = item - row * dst.shape[2]
        k = row // dst.shape[1]
        y = row - k * dst.shape[1]
        above = src[k, 2 * y, 2 * x] + src[k, 2 * y, 2 * x + 1]
        below = src[k, 2 * y + 1, 2 * x] + src[k, 2 * y + 1, 2 * x + 1]
        dst[k, y, x] = (above + below) // 4


@wp.kernel
def _count(
    stride: int,
    first: int,
    last: int,
    levels: wp.array2d[int],
    each: int,
    # outputs
    counts: wp.array2d[int],
):
    for item in range(first + wp.tid(), last, stride):
        k = item // each
        for i in range(item - k * each, levels.shape[1], each):
            wp.atomic_add(counts, k, levels[k, i], 1)


@wp.kernel
def _add_up(
    stride: int,
    first: int,
    last: int,
    counts: wp.array2d[int],
    # outputs
    parts: wp.array2d[int],
):
    for item in range(first + wp.tid(), last, stride):
        k = item // parts.shape[1]
        g = item - k * parts.shape[1]
        total = int(0)
        for i in range(_GROUP):
            total += counts[k, g * _GROUP + i]
        parts[k, g] = total


@wp.kernel
def _medians(
    stride: int,
    first: int,
    last: int,
    counts: wp.array2d[int],
    parts: wp.array2d[int],
    # outputs
    found: wp.array[int],
):
    for k in range(first + wp.tid(), last, stride):
        total = wp.int64(0)
        for g in range(parts.shape[1]):
            total += wp.int64(parts[k, g])
        group = int(0)
        level = int(0)
        below = wp.int64(0)
        rest = wp.int64(0)
        for g in range(parts.shape[1]):
            below += wp.int64(parts[k, g])
            if below + below < total:
                group = g + 1
                rest = below
        for i in range(_GROUP):
            rest += wp.int64(counts[k, group * _GROUP + i])
            if rest + rest < total:
                level = i + 1
        found[k] = group * _GROUP + level


@wp.kernel
def _split(
    stride: int,
    first: int,
    last: int,
    levels: wp.array2d[int],
    medians: wp.array[int],
    noise: int,
    # outputs
    sides: wp.array2d[wp.uint8],
):
    for item in range(first + wp.tid(), last, stride):
        k = item // levels.shape[1]
        i = item - k * levels.shape[1]
        off = levels[k, i] - medians[k]
        side = int(0)
        if off > noise:
            side = 2
        if off < -noise:
            side = 1
        sides[k, i] = wp.uint8(side)


@wp.kernel
def _compare(
    stride: int,
    sides: wp.array3d[wp.uint8],
    fixed: int,
    shifts: wp.array2d[int],
    # outputs
    sums: wp.array3d[int],
):
    k, begin = wp.tid()
    height = sides.shape[1]
    width = sides.shape[2]
    dy = 2 * shifts[k, 0]
    dx = 2 * shifts[k, 1]
    found = _Each()
    for i in range(begin, height * width, stride):
        y = i // width
        x = i - y * width
        there = int(sides[fixed, y, x])
        if there > 0:
            for n in range(_MOVES):
                v = y - dy - _DOWN[n]
                u = x - dx - _ALONG[n]
                if v >= 0 and v < height and u >= 0 and u < width:
                    if int(sides[k, v, u]) + there == 3:
                        found[n] += 1
    for n in range(_MOVES):
        wp.atomic_add(sums, k, begin % _PARTS, n, found[n])


@wp.kernel
def _choose(
    stride: int,
    first: int,
    last: int,
    sums: wp.array3d[int],
    height: int,
    width: int,
    # outputs
    shifts: wp.array2d[int],
):
    for k in range(first + wp.tid(), last, stride):
        dy = 2 * shifts[k, 0]
        dx = 2 * shifts[k, 1]
        best = int(0)
        off = wp.int64(0)
        size = wp.int64(0)
        for n in range(_MOVES):
            differ = wp.int64(0)
            for part in range(_PARTS):
                differ += wp.int64(sums[k, part, n])
            tall = wp.int64(wp.max(height - wp.abs(dy + _DOWN[n]), 0))
            common = tall * wp.int64(wp.max(width - wp.abs(dx + _ALONG[n]), 0))
            if common > wp.int64(0):
                if size == wp.int64(0) or differ * size < off * common:
                    best = n
                    off = differ
                    size = common
        shifts[k, 0] = dy + _DOWN[best]
        shifts[k, 1] = dx + _ALONG[best]
