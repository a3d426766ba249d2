"""The weighted median of disparities, guided by an image, in Warp.

The median runs along the rows, and then down the columns of the result. A pixel of the window has
the weight max(1, contrast - g), where g is the difference of the guide's values there and in the
middle. Values are in ascending order, equal ones in the order of their places. The median is the
first value at which the sum of the weights reaches half of the total. Each pair of values is
compared once. On the CPU a thread takes a slab of rows, 16 pixels at once; on CUDA it takes two
neighbouring pixels, with their windows in its registers.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs

from . import _medians_cpu as cpu
from . import _medians_cuda as cuda


def guided_median(
    disparity: wp.array, guide: wp.array, radius: int, contrast: int, smooth: wp.array
) -> None:
    """Apply the weighted median along the rows, then down the columns.

    A pixel that differs by g from the middle one in the guide has the weight
    ``max(1, contrast - g)``. Outside the image, the nearest pixel is repeated.
    """
    height, width = smooth.shape
    across = scratch("guided_median.across", (height, width), wp.float32, smooth.device)
    if smooth.device.is_cuda:
        along, down = cuda.medians(radius, contrast)
        launch(along, (height, -(-width // 2)), [disparity, guide, contrast], [across])
        launch(down, (-(-height // 2), width), [across, guide, contrast], [smooth])
        return
    count = slabs(height, smooth.size * (2 * radius + 1))
    line = (count, width + 2 * radius)
    lines = scratch("guided_median.lines", line, wp.float32, smooth.device)
    grays = scratch("guided_median.grays", line, wp.uint8, smooth.device)
    for values, down, out in ((disparity, False, across), (across, True, smooth)):
        inputs = [values, guide, radius, contrast, down, lines, grays]
        launch_slabs(cpu.medians, height, count, inputs, [out])


def max_radius() -> int:
    """Return the largest radius that the kernels support."""
    return cpu.MAX_RADIUS
