"""The census transform and the Hamming distance, in Warp.

Bit n of a pixel's census says whether its neighbour n, in raster order, is darker than the pixel
(R. Zabih and J. Woodfill, ECCV 1994); of the symmetric census, whether it is darker than its mirror
image (R. Spangenberg, T. Langner and R. Rojas, CAIP 2013). On the CPU a thread takes a slab of
rows, on CUDA a pixel.
"""

import warp as wp

from cvkern.kernels.codes.stereo import Cost
from cvkern.kernels.warp._launch import launch_slabs, scratch, slabs

from . import _census_cpu as cpu
from . import _census_cuda as cuda
from .windows import window_costs


def census(
    image: wp.array, radius_y: int, radius_x: int, spacing: int, symmetric: bool, bits: wp.array
) -> None:
    """Census transform of each channel of uint8 or float32 (H, W, C), one bit a comparison."""
    if image.device.is_cuda:
        cuda.census(image, radius_y, radius_x, spacing, symmetric, bits)
        return
    height, width, step = image.shape
    size = 2 * radius_y * spacing + 1
    count = slabs(height, image.size * (2 * radius_y + 1) * (2 * radius_x + 1))
    # Elements are taken 64 at a time: the windows of the last ones reach so far behind a row.
    shape = (count * size, (width + 2 * radius_x * spacing) * step + 64)
    lines = scratch("census.lines", shape, image.dtype, image.device)
    launch_slabs(
        cpu.census(image.dtype),
        height,
        count,
        [image, radius_y, radius_x, spacing, int(symmetric), lines],
        [bits],
    )


def hamming(left: wp.array, right: wp.array, first: int, costs: wp.array) -> None:
    """Bits that differ between the pixels of a pair, for each disparity from `first` on.

    On the CPU these are the sums over windows of one pixel.
    """
    if left.device.is_cuda:
        cuda.hamming(left, right, first, costs)
        return
    window_costs(left, right, first, Cost.CENSUS, 8, 0, 0, costs)
