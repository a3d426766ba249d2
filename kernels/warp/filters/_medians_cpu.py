"""The median on the CPU: one thread a slab of rows, a row at a time.

What is done to each pixel of a row is C (`wp.func_native`), because it becomes vector code as it
stands, of bytes 32 at a time. _medians_cuda.py has the same in Warp.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp._borders import border_index

wp.set_module_options({"enable_backward": False})

# The value of rank r is the largest v with at most r window values below v: bit by bit, for 64
# pixels at once. A count is at most 15 * 15, and fits into whatever the values do.
_ROW = """
    const int size = 2 * radius + 1, pitch = window.shape[1], columns = dst.shape[1];
    const TYPE rank = (TYPE)(size * size / 2);
    const TYPE* lines = window.data + (size_t)slab * size * pitch;
    TYPE* out = dst.data + (size_t)row * columns;
    for (int begin = 0; begin < columns; begin += 64) {
        const int count = columns - begin < 64 ? columns - begin : 64;
        TYPE found[64], middle[64], below[64];
        for (int k = 0; k < 64; ++k) found[k] = (TYPE)low;
        for (int bit = bits - 1; bit >= 0; --bit) {
            const TYPE half = (TYPE)(1u << bit);
            #pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < 64; ++k) {
                middle[k] = (TYPE)(found[k] + half);
                below[k] = 0;
            }
            for (int line = 0; line < size; ++line)
                for (int u = 0; u < size; ++u) {
                    const TYPE* value = lines + (size_t)line * pitch + begin + u * step;
                    #pragma clang loop vectorize(assume_safety)
                    for (int k = 0; k < 64; ++k) below[k] += value[k] < middle[k];
                }
            #pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < 64; ++k) found[k] += half & (TYPE)-(below[k] <= rank);
        }
        for (int k = 0; k < count; ++k) out[begin + k] = found[k];
    }
"""

# One row of the image into a line of the window, with what lies outside on both sides.
_LINE = """
    const int pitch = window.shape[1], columns = src.shape[1], margin = radius * step;
    TYPE* to = window.data + (size_t)line * pitch;
    const TYPE* from = src.data + (size_t)(row < 0 ? 0 : row) * columns;
    #pragma clang loop vectorize(assume_safety)
    for (int i = 0; i < columns; ++i) to[margin + i] = row < 0 ? (TYPE)cval : from[i];
"""


def _median(scalar: Any, c_type: str) -> wp.Kernel:
    """Return the kernel for values of one type."""

    @wp.func_native(_ROW.replace("TYPE", c_type))
    def median_row(
        slab: int,
        row: int,
        radius: int,
        step: int,
        low: int,
        bits: int,
        window: wp.array2d[scalar],
        dst: wp.array2d[scalar],
    ): ...

    @wp.func_native(_LINE.replace("TYPE", c_type))
    def copy_row(
        src: wp.array2d[scalar],
        row: int,
        radius: int,
        step: int,
        cval: int,
        line: int,
        window: wp.array2d[scalar],
    ): ...

    @wp.kernel
    def median(
        slab: int,
        first: int,
        last: int,
        src: wp.array2d[scalar],  # (P H, W step)
        height: int,
        radius: int,
        step: int,
        low: int,
        bits: int,
        border: int,
        cval: int,
        # scratch
        window: wp.array2d[scalar],  # (slabs (2 radius + 1), W step + 2 radius step + 64)
        # outputs
        dst: wp.array2d[scalar],  # (P H, W step)
    ):
        # The line of row y + t of a plane is its number modulo the size of the window: from one row
        # to the next, one line is new.
        size = 2 * radius + 1
        margin = radius * step
        columns = src.shape[1]
        for row in range(first, last):
            y = row % height
            oldest = wp.where(row == first or y == 0, y - radius, y + radius)
            for v in range(oldest, y + radius + 1):
                inside = border_index(v, height, border)
                line = slab * size + (v + size) % size
                from_row = wp.where(inside < 0, -1, row - y + inside)
                copy_row(src, from_row, radius, step, cval, line, window)
                for i in range(margin):
                    for side in range(2):
                        at = wp.where(side == 0, i - margin, columns + i)
                        pixel = wp.floordiv(at, step)
                        j = border_index(pixel, columns // step, border)
                        value = scalar(cval)
                        if j >= 0:
                            value = window[line, margin + j * step + at - pixel * step]
                        window[line, margin + at] = value
            median_row(slab, row, radius, step, low, bits, window, dst)

    return median


medians = {wp.uint8: _median(wp.uint8, "unsigned char"), wp.int32: _median(wp.int32, "int")}
