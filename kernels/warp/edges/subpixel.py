"""Sub-pixel edge points, in Warp: a thread a row (CPU), or a block of threads a row (CUDA).

Across a blurred straight step the gradient is a Gaussian, along both axes. Its logarithm is a
parabola, and the edge is at the maximum of this parabola. With p and q the logarithms before and
after a pixel less the one at it, the maximum is at the offset ``(p - q) / (2 (p + q))``. There are
two passes: the points of each row are counted, and then listed at the row's place.
"""

import warp as wp

from cvkern.kernels.warp._launch import BLOCK, launch

from . import _subpixel_cuda as cuda
from ._parabolas import is_peak, locate, three_lengths

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def _count_edges(
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    mask: wp.array2d[wp.uint8],  # (H, W)
    # outputs
    counts: wp.array[int],  # (H,)
):
    y = wp.tid()
    count = int(0)
    for x in range(mask.shape[1]):
        if mask[y, x] != wp.uint8(0):
            if is_peak(three_lengths(dy, dx, y, x)):
                count += 1
    counts[y] = count


@wp.kernel
def _gather_edges(
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    mask: wp.array2d[wp.uint8],  # (H, W)
    starts: wp.array[int],  # (H,)
    # outputs
    points: wp.array2d[float],  # (N, 2)
    orientation: wp.array[float],  # (N,)
    strength: wp.array[float],  # (N,)
):
    y = wp.tid()
    i = starts[y]
    for x in range(mask.shape[1]):
        if mask[y, x] != wp.uint8(0):
            m = three_lengths(dy, dx, y, x)
            if is_peak(m):
                locate(dy, dx, y, x, m, i, points, orientation, strength)
                i += 1


def count_edges(dy: wp.array, dx: wp.array, mask: wp.array, counts: wp.array) -> None:
    """Count the sub-pixel edge points of each row."""
    rows = mask.shape[0]
    if counts.device.is_cuda:
        launch(cuda.count_edges, rows * BLOCK, [dy, dx, mask], [counts])
        return
    launch(_count_edges, rows, [dy, dx, mask], [counts])


def gather_edges(
    dy: wp.array,
    dx: wp.array,
    mask: wp.array,
    starts: wp.array,
    points: wp.array,
    orientation: wp.array,
    strength: wp.array,
) -> None:
    """Locate the edge points of each row, and list them at its place in `starts`."""
    rows, inputs, outputs = mask.shape[0], [dy, dx, mask, starts], [points, orientation, strength]
    if points.device.is_cuda:
        launch(cuda.gather_edges, rows * BLOCK, inputs, outputs)
        return
    launch(_gather_edges, rows, inputs, outputs)
