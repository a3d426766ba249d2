"""Order statistics of an image's gradients, in Warp; _quantiles.py has the method."""

import warp as wp

from cvkern.kernels.codes.edges import BINS, DIGITS
from cvkern.kernels.warp._launch import BLOCK, launch, launch_slabs, scratch, slabs

from . import _quantiles as order
from . import _quantiles_cuda as cuda


def find_limits(
    dy: wp.array,
    dx: wp.array,
    norm: int,
    ranks: wp.array,
    strict: bool,
    share: float,
    limits: wp.array,
) -> None:
    """Find two order statistics of the gradient's length digit by digit, from histograms."""
    on_cuda = dy.device.is_cuda
    count = 1 if on_cuda else slabs(dy.shape[0], dy.size)
    counts = scratch("quantiles.counts", (count, 2, BINS), wp.int32, dy.device)
    most = scratch("quantiles.most", (count,), wp.int32, dy.device)
    found = scratch("quantiles.found", (2, 2), wp.int32, dy.device)  # prefix, rank within it
    launch(order.begin, 2, [ranks], [found])
    for level, (shift, width) in enumerate(DIGITS):
        given = [dy, dx, norm, level, shift, width, found]
        if on_cuda:
            launch(order.clear, BINS, [], [counts, most])
            launch(cuda.count_pixels, cuda.COUNTING * BLOCK, given, [counts, most])
            launch(cuda.choose, 2 * BLOCK, [counts, level, width], [found])
        else:
            launch_slabs(order.count_rows, dy.shape[0], count, given, [counts, most])
            launch(order.choose, 2, [counts, count, level, width], [found])
    launch(order.finish, 2, [found, most, count, norm, strict, share], [limits])
