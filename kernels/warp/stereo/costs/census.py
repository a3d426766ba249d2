"""The census transform and the Hamming distance, in Warp.

Bit n of a pixel's census tells whether neighbour n, in raster order, is darker than the pixel (R.
Zabih and J. Woodfill, ECCV 1994). In the symmetric census, it tells whether neighbour n is darker
than its mirror image (R. Spangenberg, T. Langner and R. Rojas, CAIP 2013). On the CPU a thread
takes a slab of rows, on CUDA a pixel.
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
    """Compute the census of each channel of uint8 or float32 (H, W, C), one bit per comparison."""
    if image.device.is_cuda:
        cuda.census(image, radius_y, radius_x, spacing, symmetric, bits)
        return
    height, width, step = image.shape
    size = 2 * radius_y * spacing + 1
    count = slabs(height, image.size * (2 * radius_y + 1) * (2 * radius_x + 1))
    # Elements are processed 64 at a time, so windows may reach this far beyond the end of a row.
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
    """Count differing bits between the pixels of a pair, for disparities that begin at `first`.

    On the CPU this is a sum over windows of one pixel.
    """
    if left.device.is_cuda:
        cuda.hamming(left, right, first, costs)
        return
    window_costs(left, right, first, Cost.CENSUS, 8, 0, 0, costs)
