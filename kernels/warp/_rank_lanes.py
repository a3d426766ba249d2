"""The median on the CPU: one thread a slab of rows, a vector of pixels at a time."""

import warp as wp

from ._borders import border_index
from ._lanes import LANES, i32_lanes

wp.set_module_options({"enable_backward": False})


@wp.kernel
def median(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[int],  # (P H, N)
    height: int,
    columns: int,
    radius: int,
    step: int,
    low: int,
    bits: int,
    border: int,
    cval: int,
    # scratch
    window: wp.array3d[int],  # (slabs, 2 radius + 1, radius step + N + radius step)
    window_lanes: wp.array3d[i32_lanes],
    # outputs
    dst_lanes: wp.array2d[i32_lanes],  # (P H, N)
):
    # The value of rank r is the largest v with at most r window values below v: bit by bit.
    size = 2 * radius + 1
    margin = radius * step
    rank = size * size // 2
    for row in range(first, last):
        y = row % height
        for t in range(size):
            v = border_index(y + t - radius, height, border)
            for i in range(window.shape[2]):
                pixel = wp.floordiv(i - margin, step)
                inside = border_index(pixel, columns // step, border)
                if i - margin >= columns + margin or v < 0 or inside < 0:
                    window[slab, t, i] = cval
                else:
                    c = i - margin - pixel * step
                    window[slab, t, i] = src[row - y + v, inside * step + c]
        for lane in range((src.shape[1] + LANES - 1) // LANES):
            x = wp.min(lane * LANES, src.shape[1] - LANES)
            found = i32_lanes(low)
            for b in range(bits):
                middle = found + i32_lanes(1 << (bits - 1 - b))
                below = i32_lanes(0)
                for t in range(size):
                    for u in range(size):
                        value = window_lanes[slab, t, x + u * step]
                        for k in range(LANES):
                            below[k] += wp.where(value[k] < middle[k], 1, 0)
                for k in range(LANES):
                    if below[k] <= rank:
                        found[k] = middle[k]
            dst_lanes[row, x] = found
