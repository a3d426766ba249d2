"""The median on CUDA, one thread per element.

The value of rank r is the largest v with at most r window values below v. It is found bit by bit,
from the highest bit. Small windows stay in registers.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp._borders import border_index
from cvkern.kernels.warp._order import ordered

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


def _small_median(scalar: Any, radius: int) -> wp.Kernel:
    """Return the kernel for values of one type and windows that stay in registers."""
    side = 2 * radius + 1
    count = side * side
    registers = wp.types.vector(count, wp.int32)

    @wp.kernel
    def median(
        src: wp.array3d[scalar],  # (P, H, W step)
        step: int,
        low: int,
        bits: int,
        border: int,
        cval: int,
        # outputs
        dst: wp.array3d[scalar],
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
                    window[t * side + u] = int(src[plane, y, x * step + channel])
        found = low
        for b in range(bits):
            middle = found + (1 << (bits - 1 - b))
            below = int(0)
            for k in range(count):
                below += wp.where(window[k] < middle, 1, 0)
            if below <= count // 2:
                found = middle
        dst[plane, row, column] = scalar(found)

    return median


medians = {scalar: _median(scalar) for scalar in (wp.uint8, wp.int32)}
small_medians = {
    (scalar, radius): _small_median(scalar, radius)
    for scalar in (wp.uint8, wp.int32)
    for radius in (1, 2)
}


@wp.kernel
def keys_of_floats(
    bits: wp.array[int],
    # outputs
    keys: wp.array[int],
):
    i = wp.tid()
    b = bits[i]
    if (b & 0x7FFFFFFF) > 0x7F800000:  # a NaN of any sign is placed above infinity
        b = 0x7FC00000
    keys[i] = ordered(b)


@wp.kernel
def floats_of_keys(
    keys: wp.array[int],
    # outputs
    bits: wp.array[int],
):
    i = wp.tid()
    bits[i] = ordered(keys[i])
