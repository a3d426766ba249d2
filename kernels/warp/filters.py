"""Linear filters, gradients in polar form and the median, in Warp.

Each primitive has two kernels: over lanes for the CPU, over blocks of outputs for CUDA.
"""

import warp as wp

from . import _filters_blocks as blocks
from . import _filters_lanes as lanes
from ._lanes import LANES, f32_lanes, i32_lanes, padded, unpad, vectors
from ._launch import launch, launch_slabs, scratch, slabs


def correlate_separable(
    src: wp.array,
    taps_y: wp.array,
    taps_x: wp.array,
    step: int,
    border: int,
    cval: float,
    dst: wp.array,
) -> None:
    """Correlate down the rows, then along the columns; neighbours are `step` elements apart."""
    planes, height, columns = src.shape
    rows = planes * height
    if dst.device.is_cuda:
        blocks.correlate_columns(src, taps_y, border, cval, middle := _middle(src))
        blocks.correlate_rows(middle, taps_x, step, border, cval, dst)
        return
    src, dst = src.reshape((rows, columns)), dst.reshape((rows, columns))
    wide_src, wide_dst = padded(src, "correlate.src"), padded(dst, "correlate.dst")
    count = slabs(rows, src.size)
    margin = taps_x.shape[0] // 2 * step
    line = scratch(
        "correlate.line", (count, wide_src.shape[1] + 2 * margin), wp.float32, dst.device
    )
    launch_slabs(
        lanes.correlate_separable,
        rows,
        count,
        [
            wide_src,
            vectors(wide_src, f32_lanes),
            height,
            columns,
            taps_y,
            taps_x,
            step,
            border,
            cval,
            line,
            vectors(line, f32_lanes),
        ],
        [vectors(wide_dst, f32_lanes)],
    )
    unpad(wide_dst, dst)


def polar(dy: wp.array, dx: wp.array, magnitude: wp.array, orientation: wp.array) -> None:
    """Length and angle of each (dy, dx); one thread an element on CUDA."""
    if dy.device.is_cuda:
        flat = (dy.size,)
        launch(
            blocks.polar,
            flat,
            [dy.reshape(flat), dx.reshape(flat)],
            [magnitude.reshape(flat), orientation.reshape(flat)],
        )
        return
    flat = (1, dy.size)
    given = [a.reshape(flat) for a in (dy, dx, magnitude, orientation)]
    wide = [padded(a, f"polar.{i}") for i, a in enumerate(given)]
    views = [vectors(a, f32_lanes) for a in wide]
    launch_slabs(lanes.polar, -(-dy.size // LANES), slabs(dy.size, dy.size), views[:2], views[2:])
    for a, b in zip(wide[2:], given[2:], strict=True):
        unpad(a, b)


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
    """Median of each square window by bisection of the values; one thread an element on CUDA."""
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


def _middle(src: wp.array) -> wp.array:
    """Scratch for the image between the two passes."""
    return scratch("correlate.middle", src.shape, wp.float32, src.device)
