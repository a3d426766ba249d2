"""The line that a point belongs to, on CUDA: one thread per point, which stops at its first line.

A point (y, x) is on a line if ``|x cos + y sin - rho|`` is at most a distance and its direction is
within a tolerance of the line's.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

HALF_TURN = wp.constant(DIRECTIONS // 2)


@wp.kernel
def claim(
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
    i = wp.tid()
    y = points[i, 0]
    x = points[i, 1]
    code = codes[i]
    k = after[i] + 1
    searching = bool(True)
    while searching and k < lines.shape[1]:
        turn = (code - directions[k]) & (HALF_TURN - 1)
        angle = wp.min(turn, HALF_TURN - turn)
        away = wp.abs((x * lines[0, k] + y * lines[1, k]) - lines[2, k])
        searching = away > distance or angle > tolerance
        k += 1
    labels[i] = wp.where(searching, k, k - 1)
