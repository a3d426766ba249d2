"""Zero-mean normalised cross-correlation of windows, in Warp.

With n pixels in a window, and sums S over it, the correlation of the windows l and r is

    (n S(l r) - S(l) S(r)) / sqrt((n S(l l) - S(l)^2) (n S(r r) - S(r)^2))

where each of the three differences is summed over the channels. The sums of each image are computed
first (_moments.py), then the sums of products, as in windows.py. Everything but sums of integers is
float64.
"""

import warp as wp

from cvkern.kernels.codes.stereo import Cost
from cvkern.kernels.warp._launch import launch_slabs, scratch, slabs

from . import _correlation_cpu as cpu
from . import _windows_cpu as windows_cpu
from . import _windows_cuda as windows_cuda
from ._moments import moments


def correlation(
    left: wp.array, right: wp.array, first: int, radius_y: int, radius_x: int, costs: wp.array
) -> None:
    """Compute 1 minus the correlation of windows of uint8 or float32 (H, W, C), a mean per channel.

    Sums of products of uint8 must fit into int32.
    """
    of_both = [
        moments(name, image, radius_y, radius_x)
        for name, image in (("left", left), ("right", right))
    ]
    windows = windows_cpu.windows_of(first, 1, radius_y, radius_x)
    if left.device.is_cuda:
        windows_cuda.correlation(left, right, windows, of_both, costs)
        return
    height, width, channels = left.shape
    count, depth = slabs(height, costs.size), costs.shape[2]
    products = cpu.products_dtype(left.dtype)
    inner = windows_cpu.slab_scratch(left, count, depth, Cost.ZNCC, windows, products)
    shape = (count, (1 + channels) * (width + windows_cpu.padded(depth, products)))
    partners = scratch("zncc.moments", shape, wp.float64, left.device)
    launch_slabs(
        cpu.correlation(left.dtype),
        height,
        count,
        [left, right, windows, *of_both, *inner, partners],
        [costs],
    )
