"""Linear filters in Warp: over lanes on the CPU, over blocks of outputs on CUDA.

A pass is ``out[i] = sum over t of taps[t] * in[i + t - r]``, summed in the order of the taps: one
pass down the rows, then one along the columns.
"""

from functools import lru_cache
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
    if _is_narrow(height, columns):
        _correlate_narrow(
            flat, (planes, step, columns // step, height), (taps_y, taps_x), border, cval
        )
        return
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


def _is_narrow(height: int, columns: int) -> bool:
    """Tell whether most lanes of a row would be empty, and a column would fill them."""
    return columns <= WIDE // 4 and height >= 4 * WIDE


def _correlate_narrow(
    flat: list[wp.array],
    shape: tuple[int, int, int, int],
    taps: tuple[wp.array, wp.array],
    border: int,
    cval: float,
) -> None:
    """Correlate the turned image, whose rows (P, C, W, H) are the columns of the image."""
    planes, step, width, height = shape
    src, dst = flat
    turned, middle = (scratch(f"correlate.{n}", shape, wp.float32, dst.device) for n in "tm")
    count = slabs(src.shape[0], src.size)
    launch_slabs(cpu.turn, src.shape[0], count, [src, height], [turned])
    one, image = _one(), (planes * step, width, height)
    sides = [view(a, wp.float32, image) for a in (turned, middle)]
    # Down the rows of the image first: in the other order, sums would be rounded in another way.
    correlate_separable(sides[0], one, taps[0], 1, border, cval, sides[1])
    correlate_separable(sides[1], taps[1], one, 1, border, cval, sides[0])
    launch_slabs(cpu.turn_back, src.shape[0], count, [turned, height], [dst])


@lru_cache
def _one() -> wp.array:
    """Return the taps of a pass that changes nothing."""
    return wp.ones(1, dtype=wp.float32, device="cpu")


def _correlate_integers(
    src: wp.array, taps_y: wp.array, taps_x: wp.array, step: int, border: int, cval: float, dst: Any
) -> None:
    planes, height, columns = src.shape
    rows, device = planes * height, dst.device
    if device.is_cuda or _is_narrow(height, columns):
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
