"""The median on CUDA, one thread an element."""

import warp as wp

from ._borders import border_index

wp.set_module_options({"enable_backward": False})


@wp.kernel
def median(
    src: wp.array3d[int],  # (P, H, W step)
    radius: int,
    step: int,
    low: int,
    bits: int,
    border: int,
    cval: int,
    # outputs
    dst: wp.array3d[int],
):
    # The value of rank r is the largest v with at most r window values below v: bit by bit.
    plane, row, column = wp.tid()
    pixel = column // step
    channel = column - pixel * step
    size = 2 * radius + 1
    found = low
    for b in range(bits):
        middle = found + (1 << (bits - 1 - b))
        below = int(0)
        for t in range(size):
            y = border_index(row + t - radius, src.shape[1], border)
            for u in range(size):
                x = border_index(pixel + u - radius, src.shape[2] // step, border)
                value = cval
                if y >= 0 and x >= 0:
                    value = src[plane, y, x * step + channel]
                if value < middle:
                    below += 1
        if below <= size * size // 2:
            found = middle
    dst[plane, row, column] = found


@wp.kernel
def turn_negative(
    src: wp.array[int],
    # outputs
    dst: wp.array[int],
):
    i = wp.tid()
    v = src[i]
    if v < 0:
        v = v ^ 0x7FFFFFFF
    dst[i] = v
