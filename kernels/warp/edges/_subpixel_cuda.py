"""Sub-pixel edge points on CUDA: a block of threads a row, each thread some neighbouring pixels."""

import warp as wp

from cvkern.kernels.warp._launch import BLOCK
from cvkern.kernels.warp._ranks_cuda import rank_in_block

from ._parabolas import is_peak, locate, three_lengths

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

THREADS = wp.constant(BLOCK)


@wp.func
def _span(width: int, thread: int) -> wp.vec2i:
    """Return the first pixel of a thread, and the one behind the last."""
    each = (width + THREADS - 1) // THREADS
    return wp.vec2i(wp.min(thread * each, width), wp.min((thread + 1) * each, width))


@wp.func
def _edges_of(
    dy: wp.array2d[float], dx: wp.array2d[float], mask: wp.array2d[wp.uint8], y: int, span: wp.vec2i
) -> int:
    count = int(0)
    for x in range(span[0], span[1]):
        if mask[y, x] != wp.uint8(0):
            if is_peak(three_lengths(dy, dx, y, x)):
                count += 1
    return count


@wp.kernel
def count_edges(
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    mask: wp.array2d[wp.uint8],  # (H, W)
    # outputs
    counts: wp.array[int],  # (H,)
):
    y = wp.tid() // THREADS
    thread = wp.tid() - y * THREADS
    count = _edges_of(dy, dx, mask, y, _span(mask.shape[1], thread))
    before = rank_in_block(count)
    if thread == THREADS - 1:
        counts[y] = before + count


@wp.kernel
def gather_edges(
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    mask: wp.array2d[wp.uint8],  # (H, W)
    starts: wp.array[int],  # (H,)
    # outputs
    points: wp.array2d[float],  # (N, 2)
    orientation: wp.array[float],  # (N,)
    strength: wp.array[float],  # (N,)
):
    y = wp.tid() // THREADS
    span = _span(mask.shape[1], wp.tid() - y * THREADS)
    i = starts[y] + rank_in_block(_edges_of(dy, dx, mask, y, span))
    for x in range(span[0], span[1]):
        if mask[y, x] != wp.uint8(0):
            m = three_lengths(dy, dx, y, x)
            if is_peak(m):
                locate(dy, dx, y, x, m, i, points, orientation, strength)
                i += 1
