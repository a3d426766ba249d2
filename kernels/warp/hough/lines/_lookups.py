"""What the voting for lines looks up for each point, on the CPU and on CUDA."""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS
from cvkern.kernels.warp.hough._directions import direction_code

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

HALF_TURN = wp.constant(DIRECTIONS // 2 - 1)
THREADS = 1 << 16  # of CUDA at most, where the host may not know how many points there are


@wp.kernel
def take(
    points: wp.array2d[int],  # (capacity, 2)
    starts: wp.array[int],
    values: wp.array2d[float],  # (H, W)
    threads: int,
    # outputs
    taken: wp.array[float],  # (capacity,)
):
    i = wp.tid()
    while i < starts[starts.shape[0] - 1]:
        taken[i] = values[points[i, 0], points[i, 1]]
        i += threads


@wp.kernel
def find_windows(
    starts: wp.array[int],
    orientation: wp.array[float],  # (capacity,)
    first: wp.array[int],  # (DIRECTIONS / 2,)
    number: wp.array[int],
    threads: int,
    # outputs
    windows: wp.array2d[int],  # (capacity, 2)
):
    i = wp.tid()
    while i < starts[starts.shape[0] - 1]:
        code = direction_code(orientation[i]) & HALF_TURN
        windows[i, 0] = first[code]
        windows[i, 1] = number[code]
        i += threads
