"""The matches of pairs of images in an order of their own, in Warp.

The Taichi set has the rules. On the CPU a thread takes a slab of pairs (_matches_cpu.py), on CUDA a
block a pair (_matches_cuda.py).
"""

import warp as wp

from cvkern.kernels.codes.geometry import LANES
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs

from . import _matches_cpu as cpu
from . import _matches_cuda as cuda

_MATCH = 32  # elements of work of a match, by which slabs are cut


def sort_matches(
    points0: wp.array,
    points1: wp.array,
    spans: wp.array,
    order: wp.array,
    places: wp.array,
    counts: wp.array,
    boxes: wp.array,
) -> None:
    """Sort the finite matches of each pair by a hash of their coordinates, equal ones once.

    `points0` (M, 2) are rows and columns, or (M, 3) x, y and z; `points1` (M, 2). A pair is (its
    first match, their number, its place in the result). `order` (M,) lists its matches, as many as
    `counts` (P,) says, from its first one on; `places` (M,) has their places in the result, or -1;
    `boxes` (P, 2, R) the least and the largest x0, y0, x1, y1, and z0 of a scene.
    """
    keys = scratch("matches.keys", (2 * points0.shape[0],), wp.uint64, order.device)
    inputs, outputs = [points0, points1, spans, keys], [order, places, counts, boxes]
    pairs = spans.shape[0]
    if order.device.is_cuda:
        launch(cuda.sort_pair, pairs * cuda.THREADS, inputs, outputs, cuda.THREADS)
        return
    parts = slabs(pairs, _MATCH * points0.shape[0])
    heads = scratch("matches.heads", (parts, cpu.BUCKETS + 1), wp.int32, order.device)
    launch_slabs(cpu.sort_pairs, pairs, parts, [*inputs, heads], outputs)


def scale_matches(
    points0: wp.array,
    points1: wp.array,
    spans: wp.array,
    order: wp.array,
    counts: wp.array,
    scales: wp.array,
    matches: wp.array,
) -> None:
    """Write the sorted matches times a scale less a shift, `scales` (P, 2, R), to (R, T).

    Zeros follow those of a pair, up to a multiple of `LANES`.
    """
    inputs, pairs = [points0, points1, spans, order, counts, scales, LANES], spans.shape[0]
    if matches.device.is_cuda:
        launch(cuda.scale_pair, pairs * cuda.THREADS, inputs, [matches], cuda.THREADS)
        return
    parts = slabs(pairs, _MATCH * points0.shape[0])
    launch_slabs(cpu.scale_pairs, pairs, parts, inputs, [matches])
