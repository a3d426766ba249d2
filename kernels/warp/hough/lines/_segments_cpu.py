"""The line that a point belongs to, on the CPU: one thread per slab of blocks of 64 points.

A point (y, x) is on a line if ``|x cos + y sin - rho|`` is at most a distance and its direction is
within a tolerance of the line's. The 64 points of a block are tested against one line after the
other, as vector code without branches.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS
from cvkern.kernels.warp._lanes_cpu import WIDE, f32_wide

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

HALF_TURN = wp.constant(DIRECTIONS // 2)
i32_wide = wp.types.vector(WIDE, wp.int32)


@wp.kernel
def claim(
    slab: int,
    first: int,
    last: int,
    points: wp.array2d[float],  # (N, 2)
    codes: wp.array[int],  # (N,)
    after: wp.array[int],  # (N,)
    lines: wp.array2d[float],  # (3, K): cosine, sine, rho
    directions: wp.array[int],  # (K,)
    distance: float,
    tolerance: int,
    # outputs
    labels: wp.array[int],  # (N,)
):
    # Rows of a slab are blocks of points.
    count = lines.shape[1]
    for block in range(first, last):
        begin = WIDE * block
        size = wp.min(WIDE, points.shape[0] - begin)
        y = f32_wide()
        x = f32_wide()
        code = i32_wide()
        past = i32_wide()
        label = i32_wide(count)
        for i in range(size):
            y[i] = points[begin + i, 0]
            x[i] = points[begin + i, 1]
            code[i] = codes[begin + i]
            past[i] = after[begin + i]
        for k in range(count):
            cosine = lines[0, k]
            sine = lines[1, k]
            rho = lines[2, k]
            direction = directions[k]
            for i in range(WIDE):
                away = wp.abs((x[i] * cosine + y[i] * sine) - rho)
                turn = (code[i] - direction) & (HALF_TURN - 1)
                angle = wp.min(turn, HALF_TURN - turn)
                on = int(away <= distance) & int(angle <= tolerance) & int(k > past[i])
                label[i] = wp.min(label[i], wp.where(on != 0, k, count))
        for i in range(size):
            labels[begin + i] = label[i]
