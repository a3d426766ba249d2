"""The median on the CPU: one thread per slab of rows, row by row.

Windows of 3 x 3 and 5 x 5 pixels go through networks of exchanges. In larger ones, the value of
rank r is the largest v with at most r window values below v; it is found bit by bit, from the
highest bit. A slab keeps the rows of its window, with margins, and copies one new row for each row
of the result. Exchanges and counts are native, because they become vector code for 32 bytes at a
time.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._borders import border_index
from cvkern.kernels.warp._lanes_cpu import WIDE

wp.set_module_options({"enable_backward": False})


@wp.struct
class Options:
    """Size of the window, elements between neighbours, range of the values, and the border."""

    radius: int
    step: int
    low: int
    bits: int
    border: int
    cval: int


def _median(scalar: Any) -> wp.Kernel:
    """Return the kernel for values of one type."""
    vector = wp.types.vector(WIDE, scalar)

    @_native.func_native(
        "_medians_cpu.h",
        SCALAR=scalar,
        PIXEL=f"wp::{scalar.__name__} __attribute__((vector_size(32)))",
        LEAST="__builtin_elementwise_min",
        MOST="__builtin_elementwise_max",
    )
    def median_row(
        slab: int,
        plane: int,
        row: int,
        radius: int,
        step: int,
        low: int,
        bits: int,
        window: wp.array2d[scalar],
        dst: wp.array3d[scalar],
    ): ...

    @wp.kernel
    def median(
        slab: int,
        first: int,
        last: int,
        src: wp.array3d[vector],  # (P, H, N - 63), N at least W step
        options: Options,
        # scratch
        window: wp.array2d[scalar],  # (2 slabs (2 radius + 1), N + 2 radius step + 64)
        wide: wp.array2d[vector],  # the same
        # outputs
        dst: wp.array3d[scalar],  # (P, H, W step)
    ):
        # Row y + t of a plane is in the line of its number modulo the size of the window, so each
        # row of the result needs one new line.
        radius = options.radius
        step = options.step
        size = 2 * radius + 1
        margin = radius * step
        height = dst.shape[1]
        columns = dst.shape[2]
        behind = src.shape[2] - 1  # begin of the last vector of a row
        for row in range(first, last):
            plane = row // height
            y = row - plane * height
            oldest = wp.where(row == first or y == 0, y - radius, y + radius)
            for v in range(oldest, y + radius + 1):
                inside = border_index(v, height, options.border)
                line = 2 * slab * size + (v + size) % size
                for begin in range(0, behind + WIDE, WIDE):
                    x = wp.min(begin, behind)
                    if inside < 0:
                        wide[line, margin + x] = vector(scalar(options.cval))
                    else:
                        wide[line, margin + x] = src[plane, inside, x]
                for i in range(margin):
                    for side in range(2):
                        at = wp.where(side == 0, i - margin, columns + i)
                        pixel = wp.floordiv(at, step)
                        j = border_index(pixel, columns // step, options.border)
                        value = scalar(options.cval)
                        if j >= 0:
                            value = window[line, margin + j * step + at - pixel * step]
                        window[line, margin + at] = value
            median_row(slab, plane, y, radius, step, options.low, options.bits, window, dst)

    return median


medians = {scalar: _median(scalar) for scalar in (wp.uint8, wp.int32)}
