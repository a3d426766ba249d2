"""Smoothing of the levels of a scale space on the CPU, all levels of an octave in one launch.

A thread takes a band of rows and goes down it in strips, each level as many rows behind the one
before as its taps reach: it reads that level from the cache. At the borders between bands a second
launch fills what needs rows of both. The code for rows (_smoothing_cpu.h) is native, because two
rows share loads, and no arithmetic of indices stands between the sums.
"""

from collections.abc import Sequence

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch_slabs, scratch, slabs
from cvkern.kernels.warp.features._levels import kept_table

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LINE = 16  # floats of a line of the cache
STRIP = wp.constant(32)  # rows
MOST_LEVELS = 16
rows_t = wp.types.vector(MOST_LEVELS, wp.int32)


@_native.func_native("_smoothing_cpu.h")
def smooth_rows(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[float],
    taps: wp.array[float],
    margin: int,
    # scratch
    lines: wp.array2d[float],  # (2 slabs, margin + W + margin)
    # outputs
    dst: wp.array2d[float],
):
    """Smooth some rows."""


@wp.kernel
def smooth(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[float],
    taps: wp.array[float],
    margin: int,
    lines: wp.array2d[float],
    # outputs
    dst: wp.array2d[float],
):
    smooth_rows(slab, first, last, src, taps, margin, lines, dst)


@wp.func
def smooth_level(
    slab: int,
    first: int,
    last: int,
    i: int,
    taps: wp.array2d[wp.int64],
    margin: int,
    lines: wp.array2d[float],
    levels: wp.array3d[float],
):
    """Smooth some rows of a level to those of the next one, `i`."""
    if last > first:
        own = wp.array(ptr=wp.uint64(taps[i, 0]), shape=(int(taps[i, 1]),), dtype=wp.float32)
        smooth_rows(slab, first, last, levels[i - 1], own, margin, lines, levels[i])


@wp.kernel
def smooth_bands(
    slab: int,
    first: int,
    last: int,
    taps: wp.array2d[wp.int64],  # (L, 3): address, number, and reach of all up to these
    margin: int,
    lines: wp.array2d[float],
    # in place
    levels: wp.array3d[float],  # (L, H, W)
):
    count = levels.shape[0]
    height = levels.shape[1]
    done = rows_t()
    for i in range(1, count):
        if first > 0:
            done[i] = first + int(taps[i, 2])
    reach = int(taps[count - 1, 2])
    for strip in range((last - first + reach + STRIP - 1) // STRIP):
        for i in range(1, count):
            end = last
            if last < height:
                end = last - int(taps[i, 2])
            to = wp.min(end, first + (strip + 1) * STRIP - int(taps[i, 2]))
            if to > done[i]:
                smooth_level(slab, done[i], to, i, taps, margin, lines, levels)
                done[i] = to


@wp.kernel
def smooth_borders(
    slab: int,
    first: int,
    last: int,
    bands: int,
    taps: wp.array2d[wp.int64],
    margin: int,
    lines: wp.array2d[float],
    # in place
    levels: wp.array3d[float],
):
    for border in range(first + 1, last + 1):
        row = levels.shape[1] * border // bands
        for i in range(1, levels.shape[0]):
            reach = int(taps[i, 2])
            smooth_level(slab, row - reach, row + reach, i, taps, margin, lines, levels)


def fill_level(src: wp.array, taps: wp.array, dst: wp.array) -> None:
    """Smooth an image; a thread takes a slab of rows."""
    parts = slabs(src.shape[0], src.size)
    margin, lines = _lines(taps.shape[0], parts, src)
    launch_slabs(smooth, src.shape[0], parts, [src, taps, margin, lines], [dst])


def fill_levels(taps: Sequence[wp.array], levels: wp.array) -> None:
    """Smooth the first level of an octave (L, H, W) to the second, and so on."""
    count, height, _ = levels.shape
    table, reach = [[0, 0, 0]], 0
    for own in taps[1:count]:
        reach += own.shape[0] // 2
        table.append([own.ptr, own.shape[0], reach])
    given = kept_table(table, levels.device)
    bands = slabs(height, levels.size)
    if height < bands * (2 * reach + 1):
        bands = 1
    margin, lines = _lines(max(own.shape[0] for own in taps), bands, levels[0])
    launch_slabs(smooth_bands, height, bands, [given, margin, lines], [levels])
    if bands > 1:
        inputs = [bands, given, margin, lines]
        launch_slabs(smooth_borders, bands - 1, bands - 1, inputs, [levels])


def _lines(taps: int, parts: int, image: wp.array) -> tuple[int, wp.array]:
    """Return scratch memory for two rows of each part, and the room beside them."""
    margin = -(-taps // (2 * LINE)) * LINE
    shape = (2 * parts, image.shape[-1] + 2 * margin)
    return margin, scratch("keypoints.rows", shape, wp.float32, image.device)
