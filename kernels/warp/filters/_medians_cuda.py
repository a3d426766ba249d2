"""The median on CUDA, one thread per element, or per four bytes.

The value of rank r is the largest v with at most r window values below v. It is found bit by bit,
from the highest bit. Windows of 3 x 3 and 5 x 5 pixels stay in registers, and go through networks
of exchanges.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._borders import border_index

wp.set_module_options({"enable_backward": False, "max_unroll": 32})


def _median(scalar: Any) -> wp.Kernel:
    """Return the kernel for values of one type."""

    @wp.kernel
    def median(
        src: wp.array3d[scalar],  # (P, H, W step)
        radius: int,
        step: int,
        low: int,
        bits: int,
        border: int,
        cval: int,
        # outputs
        dst: wp.array3d[scalar],
    ):
        # Find the largest v with at most r window values below v, bit by bit.
        plane, row, column = wp.tid()
        height = src.shape[1]
        width = src.shape[2] // step
        pixel = column // step
        channel = column - pixel * step
        size = 2 * radius + 1
        inside = row >= radius and row + radius < height
        inside = inside and pixel >= radius and pixel + radius < width
        found = low
        for b in range(bits):
            middle = found + (1 << (bits - 1 - b))
            below = int(0)
            for t in range(-radius, radius + 1):
                for u in range(-radius, radius + 1):
                    value = cval
                    if inside:
                        value = int(src[plane, row + t, column + u * step])
                    else:
                        y = border_index(row + t, height, border)
                        x = border_index(pixel + u, width, border)
                        if y >= 0 and x >= 0:
                            value = int(src[plane, y, x * step + channel])
                    if value < middle:
                        below += 1
            if below <= size * size // 2:
                found = middle
        dst[plane, row, column] = scalar(found)

    return median


def _small_median(radius: int) -> wp.Kernel:
    """Return the kernel for integers and windows that stay in registers."""
    side = 2 * radius + 1
    registers = wp.types.vector(side * side, wp.int32)

    @_native.func_native("_medians_cuda.cu", SIDE=side, PIXEL=wp.int32, LEAST="min", MOST="max")
    def middle_of(window: registers) -> int: ...

    @wp.kernel
    def median(
        src: wp.array3d[int],  # (P, H, W step)
        step: int,
        border: int,
        cval: int,
        # outputs
        dst: wp.array3d[int],
    ):
        plane, row, column = wp.tid()
        pixel = column // step
        channel = column - pixel * step
        window = registers(cval)
        for t in range(side):
            y = border_index(row + t - radius, src.shape[1], border)
            for u in range(side):
                x = border_index(pixel + u - radius, src.shape[2] // step, border)
                if y >= 0 and x >= 0:
                    window[t * side + u] = src[plane, y, x * step + channel]
        dst[plane, row, column] = middle_of(window)

    return median


def _small_median_of_bytes(radius: int) -> wp.Kernel:
    """Return the kernel for bytes and windows that stay in registers, four to a thread."""
    side = 2 * radius + 1
    registers = wp.types.vector(side * side, wp.uint32)

    @_native.func_native(
        "_medians_cuda.cu", SIDE=side, PIXEL=wp.uint32, LEAST="__vminu2", MOST="__vmaxu2"
    )
    def middles_of(window: registers) -> wp.uint32: ...

    @_native.func_native("_medians_cuda.cu", PIXEL=wp.uint32, LEAST="__vminu2", MOST="__vmaxu2")
    def four_at(src: wp.array3d[wp.uint8], plane: int, row: int, column: int) -> wp.uint32: ...

    @wp.func
    def window_at_border(
        src: wp.array3d[wp.uint8],
        plane: int,
        row: int,
        column: int,
        size: int,
        step: int,
        border: int,
        cval: int,
    ) -> registers:
        """Return a window that reaches outside, by short loops: their code would not fit unrolled.

        `size` is `side`, which the compiler does not know.
        """
        window = registers()
        for t in range(size):
            y = border_index(row + t - size // 2, src.shape[1], border)
            for u in range(size):
                word = wp.uint32(0)
                for k in range(4):
                    at = column + k
                    x = border_index(at // step + u - size // 2, src.shape[2] // step, border)
                    byte = wp.uint32(cval)
                    if y >= 0 and x >= 0:
                        byte = wp.uint32(src[plane, y, x * step + at % step])
                    word = word | (byte << wp.uint32(8 * k))
                window[t * size + u] = word
        return window

    @wp.kernel
    def median(
        src: wp.array3d[wp.uint8],  # (P, H, W step)
        size: int,
        step: int,
        border: int,
        cval: int,
        # outputs
        dst: wp.array3d[wp.uint8],
    ):
        plane, row, quad = wp.tid()
        column = 4 * quad
        reach = radius * step
        inside = row >= radius and row + radius < src.shape[1]
        # Words around the bytes are read as well.
        inside = inside and column >= reach + 4 and column + reach + 8 <= src.shape[2]
        window = registers()
        if inside:
            for t in range(side):
                for u in range(side):
                    window[t * side + u] = four_at(
                        src, plane, row + t - radius, column + (u - radius) * step
                    )
        else:
            window = window_at_border(src, plane, row, column, size, step, border, cval)
        found = middles_of(window)
        for k in range(4):
            if column + k < src.shape[2]:
                dst[plane, row, column + k] = wp.uint8((found >> wp.uint32(8 * k)) & wp.uint32(255))

    return median


medians = {scalar: _median(scalar) for scalar in (wp.uint8, wp.int32)}
small_medians = {radius: _small_median(radius) for radius in (1, 2)}
small_medians_of_bytes = {radius: _small_median_of_bytes(radius) for radius in (1, 2)}
