"""Rank filters in Warp."""

import warp as wp

from . import _rank_blocks as blocks
from . import _rank_lanes as lanes
from ._lanes import i32_lanes, padded, unpad, vectors
from ._launch import launch, launch_slabs, scratch, slabs


def median(
    src: wp.array,
    radius: int,
    step: int,
    low: int,
    bits: int,
    border: int,
    cval: int,
    dst: wp.array,
) -> None:
    """Median of each square window by bisection of the values."""
    planes, height, columns = src.shape
    rows = planes * height
    if dst.device.is_cuda:
        launch(blocks.median, src.shape, [src, radius, step, low, bits, border, cval], [dst])
        return
    src, dst = src.reshape((rows, columns)), dst.reshape((rows, columns))
    wide_src, wide_dst = padded(src, "median.src"), padded(dst, "median.dst")
    count = slabs(rows, src.size * (2 * radius + 1) ** 2)
    shape = (count, 2 * radius + 1, wide_src.shape[1] + 2 * radius * step)
    window = scratch("median.window", shape, wp.int32, dst.device)
    launch_slabs(
        lanes.median,
        rows,
        count,
        [wide_src, height, columns, radius, step, low, bits, border, cval]
        + [window, vectors(window, i32_lanes)],
        [vectors(wide_dst, i32_lanes)],
    )
    unpad(wide_dst, dst)


def turn_negative(src: wp.array, dst: wp.array) -> None:
    """Turn round the bits below the sign of negative integers; one thread an element."""
    flat = (src.size,)
    launch(blocks.turn_negative, flat, [src.reshape(flat)], [dst.reshape(flat)])
