"""Linear filters on the CPU: one thread per slab of rows, one vector of pixels at a time.

Each row is correlated down the rows into a line of scratch, and then along the line. Two rows whose
windows lie inside the image are processed together, because they share most of the pixels that they
read.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._borders import border_index
from cvkern.kernels.warp._lanes_cpu import LANES, WIDE, f32_lanes, f32_wide

from ._separable_cpu import Lines, fill_margins, sum_down

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ROWS = 32  # rows of integers that are converted together


@_native.func_native("_linear_cpu.h")
def pair_down(
    src: wp.array2d[f32_lanes],  # (P H, N - 31)
    row: int,
    taps: wp.array[float],
    # outputs
    lines: wp.array2d[float],
    first_line: int,
    margin: int,
    first: int,
    last: int,
): ...


@_native.func_native("_linear_cpu.h")
def along(
    lines: wp.array2d[float],
    line: int,
    step: int,
    taps: wp.array[float],
    size: int,
    # outputs
    dst: wp.array3d[f32_wide],  # (P, H, N - 63)
    row: int,  # counted through all planes
): ...


@wp.struct
class Room:
    """Scratch for an image of integers; a slab has its share of each."""

    rows: Lines  # rows of the image as floats
    line: Lines  # sums down the rows, two lines per slab
    sums: wp.array3d[f32_wide]  # (1, slabs, N - 63)
    whole: wp.array2d[float]  # (slabs, N): the same


@wp.kernel
def correlate_separable(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[f32_lanes],  # (P H, N - 31)
    columns: int,  # W step <= N
    taps_y: wp.array[float],  # (2 ry + 1,)
    taps_x: wp.array[float],  # (2 rx + 1,)
    step: int,
    border: int,
    cval: float,
    # scratch
    lines: Lines,  # (2 slabs, rx step + N + rx step)
    # outputs
    dst: wp.array3d[f32_wide],  # (P, H, N - 63)
):
    height = dst.shape[1]
    stored = dst.shape[2] + WIDE - 1
    reach = taps_y.shape[0] // 2
    margin = taps_x.shape[0] // 2 * step
    row = int(first)
    while row < last:
        plane = row // height
        y = row - plane * height
        pair = row + 1 < last and y >= reach and y + 1 + reach < height
        if pair:
            pair_down(src, row, taps_y, lines.values, 2 * slab, margin, 0, stored)
        else:
            for lane in range((stored + LANES - 1) // LANES):
                x = wp.min(lane * LANES, stored - LANES)
                lines.lanes[2 * slab, margin + x] = sum_down(
                    src, row - y, y, height, x, taps_y, border, cval
                )
        for k in range(wp.where(pair, 2, 1)):
            fill_margins(lines.values, 2 * slab + k, margin, columns, step, border, cval)
            along(lines.values, 2 * slab + k, step, taps_x, stored, dst, row + k)
        row += wp.where(pair, 2, 1)


@wp.kernel
def turn(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[float],  # (P H, W C)
    height: int,
    # outputs
    dst: wp.array4d[float],  # (P, C, W, H)
):
    step = dst.shape[1]
    for row in range(first, last):
        plane = row // height
        for i in range(src.shape[1]):
            dst[plane, i % step, i // step, row - plane * height] = src[row, i]


@wp.kernel
def turn_back(
    slab: int,
    first: int,
    last: int,
    src: wp.array4d[float],  # (P, C, W, H)
    height: int,
    # outputs
    dst: wp.array2d[float],  # (P H, W C)
):
    step = src.shape[1]
    for row in range(first, last):
        plane = row // height
        for i in range(dst.shape[1]):
            dst[row, i] = src[plane, i % step, i // step, row - plane * height]


def _integers(scalar: Any, most: str) -> wp.Kernel:
    """Return the kernel for an image of integers of one type, rounded to the same type."""

    @_native.func_native("_linear_cpu.h", SCALAR=scalar)
    def widen_row(
        src: wp.array2d[scalar], row: int, cval: float, dst: wp.array2d[float], line: int
    ): ...

    @_native.func_native("_linear_cpu.h", SCALAR=scalar, MOST=most)
    def narrow_row(src: wp.array2d[float], line: int, dst: wp.array2d[scalar], row: int): ...

    @wp.kernel
    def correlate_integers(
        slab: int,
        first: int,
        last: int,
        src: wp.array2d[scalar],  # (P H, W step)
        height: int,
        taps_y: wp.array[float],
        taps_x: wp.array[float],
        step: int,
        border: int,
        cval: float,
        room: Room,
        # outputs
        dst: wp.array2d[scalar],  # (P H, W step)
    ):
        columns = src.shape[1]
        stored = room.whole.shape[1]
        reach = taps_y.shape[0] // 2
        margin = taps_x.shape[0] // 2 * step
        base = slab * (ROWS + 2 * reach + 1)
        row = int(first)
        while row < last:
            # Convert the rows around some rows of one plane, once for all of these.
            y = row % height
            number = wp.min(ROWS, wp.min(last - row, height - y))
            for i in range(number + 2 * reach):
                inside = border_index(y - reach + i, height, border)
                from_row = wp.where(inside < 0, -1, row - y + inside)
                widen_row(src, from_row, cval, room.rows.values, base + i)
            for k in range(0, number, 2):
                middle = base + reach + k
                pair_down(
                    room.rows.lanes, middle, taps_y, room.line.values, 2 * slab, margin, 0, stored
                )
                for one in range(wp.min(2, number - k)):
                    line = 2 * slab + one
                    fill_margins(room.line.values, line, margin, columns, step, border, cval)
                    along(room.line.values, line, step, taps_x, stored, room.sums, slab)
                    narrow_row(room.whole, slab, dst, row + k + one)
            row += number

    return correlate_integers


integers = {
    wp.uint8: _integers(wp.uint8, "255.0f"),
    wp.uint16: _integers(wp.uint16, "65535.0f"),
}
