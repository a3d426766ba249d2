"""The weighted median of disparities, guided by an image, in Warp.

Along the rows, and then of that down the columns. A pixel of the window weighs max(1, contrast -
g), where g is the difference of the guide's values there and in the middle. Of the values in
ascending order, equal ones in the order of their places, the first is taken whose weight and that
of all before it is at least half of the whole: each pair of values is compared once. On the CPU a
thread takes a slab of rows and 16 pixels at once, on CUDA a pixel, with the window in its
registers.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs

from . import _medians_cpu as cpu
from . import _medians_cuda as cuda


def guided_median(
    disparity: wp.array, guide: wp.array, radius: int, contrast: int, smooth: wp.array
) -> None:
    """Weighted median along the rows, then of that down the columns.

    A pixel that differs by g from the middle one in the guide weighs ``max(1, contrast - g)``. The
    image is continued by its nearest pixel.
    """
    height, width = smooth.shape
    across = scratch("guided_median.across", (height, width), wp.float32, smooth.device)
    if smooth.device.is_cuda:
        along, down = cuda.medians(radius)
        launch(along, smooth.size, [disparity, guide, contrast], [across])
        launch(down, smooth.size, [across, guide, contrast], [smooth])
        return
    options = [guide, radius, contrast]
    count = slabs(height, smooth.size * (2 * radius + 1))
    line = (count, width + 2 * radius)
    lines = scratch("guided_median.lines", line, wp.float32, smooth.device)
    grays = scratch("guided_median.grays", line, wp.uint8, smooth.device)
    launch_slabs(cpu.along, height, count, [disparity, *options, lines, grays], [across])
    launch_slabs(cpu.down, height, count, [across, *options], [smooth])


def max_radius() -> int:
    """Return the largest radius that there is room for."""
    return cpu.MAX_RADIUS
