"""Linear filters in Warp: over lanes on the CPU, over blocks of outputs on CUDA.

A pass is ``out[i] = sum over t of taps[t] * in[i + t - r]``, summed in the order of the taps: one
pass down the rows, then one along the columns.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp._lanes_cpu import WIDE, f32_lanes, f32_wide, padded, unpad, vectors
from cvkern.kernels.warp._launch import launch_slabs, scratch, slabs, view

from . import _linear_cpu as cpu
from . import _linear_cuda as cuda
from ._separable_cpu import lines
from .depths import narrow, widen


def correlate_separable(
    src: wp.array,
    taps_y: wp.array,
    taps_x: wp.array,
    step: int,
    border: int,
    cval: float,
    dst: wp.array,
) -> None:
    """Correlate down the rows, then along the columns; neighbours are `step` elements apart.

    Both images are float32, or both are integers of 8 or 16 bits; then sums are rounded.
    """
    planes, height, columns = src.shape
    rows = planes * height
    if dst.dtype is not wp.float32:
        _correlate_integers(src, taps_y, taps_x, step, border, cval, dst)
        return
    if dst.device.is_cuda:
        middle = scratch("correlate.middle", src.shape, wp.float32, dst.device)
        cuda.correlate_columns(src, taps_y, border, cval, middle)
        cuda.correlate_rows(middle, taps_x, step, border, cval, dst)
        return
    flat = [view(a, wp.float32, (rows, columns)) for a in (src, dst)]
    wide_src, wide_dst = (padded(a, f"correlate.{i}", WIDE) for i, a in enumerate(flat))
    stored = wide_dst.shape[1]
    count = slabs(rows, src.size)
    margin = taps_x.shape[0] // 2 * step
    line = lines("correlate.line", 2 * count, stored, margin, dst.device)
    launch_slabs(
        cpu.correlate_separable,
        rows,
        count,
        [vectors(wide_src, f32_lanes), columns, taps_y, taps_x, step, border, cval, line],
        [vectors(view(wide_dst, wp.float32, (planes, height, stored)), f32_wide)],
    )
    unpad(wide_dst, flat[1])


def _correlate_integers(
    src: wp.array, taps_y: wp.array, taps_x: wp.array, step: int, border: int, cval: float, dst: Any
) -> None:
    planes, height, columns = src.shape
    rows, device = planes * height, dst.device
    if device.is_cuda:
        wide, sums = (scratch(f"correlate.{n}", src.shape, wp.float32, device) for n in "ab")
        widen(src, wide)
        correlate_separable(wide, taps_y, taps_x, step, border, cval, sums)
        narrow(sums, dst)
        return
    count, stored = slabs(rows, src.size), max(columns, WIDE)
    held = cpu.ROWS + taps_y.shape[0]
    room = cpu.Room()
    room.rows = lines("correlate.rows", count * held, stored, 0, device)
    margin = taps_x.shape[0] // 2 * step
    room.line = lines("correlate.line", 2 * count, stored, margin, device)
    room.whole = scratch("correlate.sums", (count, stored), wp.float32, device)
    room.sums = vectors(view(room.whole, wp.float32, (1, count, stored)), f32_wide)
    flat = [view(a, a.dtype, (rows, columns)) for a in (src, dst)]
    inputs = [flat[0], height, taps_y, taps_x, step, border, cval, room]
    launch_slabs(cpu.integers[dst.dtype], rows, count, inputs, [flat[1]])
