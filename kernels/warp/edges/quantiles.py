"""Order statistics of an image's gradients, in Warp; _quantiles.py has the method."""

import warp as wp

from cvkern.kernels.codes.edges import BINS, DIGITS
from cvkern.kernels.warp._launch import BLOCK, launch, launch_slabs, scratch, slabs

from . import _quantiles as order
from . import _quantiles_cpu as cpu
from . import _quantiles_cuda as cuda
from ._stacks import tall


def find_limits(
    dy: wp.array,
    dx: wp.array,
    norm: int,
    ranks: wp.array,
    strict: bool,
    share: float,
    limits: wp.array,
) -> None:
    """Find two order statistics of the gradient's length digit by digit, from histograms.

    Of a stack (N, H, W), `limits` has two for each image.
    """
    on_cuda = dy.device.is_cuda
    if dy.ndim == 3 and not on_cuda:
        for n in range(dy.shape[0]):
            given = dy[n], dx[n], norm, ranks, strict, share
            find_limits(*given, limits[2 * n : 2 * n + 2])
        return
    images = limits.shape[0] // 2
    dy, dx = tall(dy), tall(dx)
    count = images if on_cuda else slabs(dy.shape[0], dy.size)
    counts = scratch("quantiles.counts", (count, 2, BINS), wp.int32, dy.device)
    most = scratch("quantiles.most", (count,), wp.int32, dy.device)
    found = scratch("quantiles.found", (2 * images, 2), wp.int32, dy.device)  # prefix, rank
    launch(order.begin, 2 * images, [ranks], [found])
    parts = -(-cuda.COUNTING // images)  # blocks of an image on CUDA
    for level, (shift, width) in enumerate(DIGITS):
        given = [dy, dx, norm, level, shift, width, found]
        if on_cuda:
            launch(order.clear, (images, BINS), [], [counts, most])
            launch(cuda.count_pixels, images * parts * BLOCK, given, [counts, most])
            launch(cuda.choose, 2 * images * BLOCK, [counts, level, width], [found])
        else:
            launch_slabs(cpu.count_rows, dy.shape[0], count, given, [counts, most])
            launch(order.choose, 2, [counts, count, level, width], [found])
    given = [found, most, count // images, norm, strict, share]
    launch(order.finish, 2 * images, given, [limits])
