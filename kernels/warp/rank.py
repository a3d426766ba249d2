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
        [
            wide_src,
            height,
            columns,
            radius,
            step,
            low,
            bits,
            border,
            cval,
            window,
            vectors(window, i32_lanes),
        ],
        [vectors(wide_dst, i32_lanes)],
    )
    unpad(wide_dst, dst)


def keys_of_floats(bits: wp.array, keys: wp.array) -> None:
    """Order the bits of floats as integers: those of negative ones turned round below the sign."""
    flat = (bits.size,)
    launch(blocks.keys_of_floats, flat, [bits.reshape(flat)], [keys.reshape(flat)])


def floats_of_keys(keys: wp.array, bits: wp.array) -> None:
    """Undo `keys_of_floats`."""
    flat = (keys.size,)
    launch(blocks.floats_of_keys, flat, [keys.reshape(flat)], [bits.reshape(flat)])
