"""Robust fits on the CPU: a thread takes a slab of groups of hypotheses, or of models.

The loops over matches (_lanes_cpu.h) are native, because they are vector code of 32 matches.
"""

import warp as wp

from cvkern.kernels.codes.geometry import (
    FLAT,
    GROUP,
    NO_COST,
    PREVIEW,
)
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FILE = "_robust_cpu.h"


@_native.func_native(_FILE, GROUP=GROUP, PREVIEW=PREVIEW, NO_COST=NO_COST, FLAT=FLAT)
def best_of_group(
    kind: int,
    seed: int,
    first: int,
    matches: wp.array2d[float],
    start: int,
    count: int,
    square: float,
    known: wp.array2d[wp.float64],
    pair: int,
    at: int,
    models: wp.array3d[float],
    costs: wp.array2d[int],
): ...


@_native.func_native(_FILE)
def improve(
    kind: int,
    matches: wp.array2d[float],
    start: int,
    count: int,
    square: float,
    known: wp.array2d[wp.float64],
    pair: int,
    schedule: wp.array[float],
    at: int,
    models: wp.array3d[wp.float64],
    scores: wp.array3d[int],
): ...


@_native.func_native(_FILE)
def mark_pair(
    kind: int,
    matches: wp.array2d[float],
    start: int,
    count: int,
    square: float,
    known: wp.array2d[wp.float64],
    at: int,
    models: wp.array2d[wp.float64],
    inliers: wp.array[wp.uint8],
): ...


@wp.kernel
def propose(
    stride: int,
    begin: int,
    end: int,
    matches: wp.array2d[float],
    spans: wp.array2d[int],
    squares: wp.array[float],
    known: wp.array2d[wp.float64],
    pairs: wp.array[int],
    draw: wp.vec3i,
    # outputs
    models: wp.array3d[float],
    costs: wp.array2d[int],
):
    groups = costs.shape[1]
    for i in range(begin + wp.tid(), end, stride):
        pair = pairs[i // groups]
        best_of_group(
            draw[0], draw[1], draw[2] + (i % groups) * wp.static(GROUP), matches,
            spans[pair, 0], spans[pair, 1], squares[pair], known, pair, i, models, costs,
        )  # fmt: skip


@wp.kernel
def refine(
    stride: int,
    begin: int,
    end: int,
    matches: wp.array2d[float],
    spans: wp.array2d[int],
    squares: wp.array[float],
    known: wp.array2d[wp.float64],
    pairs: wp.array[int],
    kind: int,
    schedule: wp.array[float],
    # outputs
    models: wp.array3d[wp.float64],
    scores: wp.array3d[int],
):
    for i in range(begin + wp.tid(), end, stride):
        pair = pairs[i // scores.shape[1]]
        improve(
            kind, matches, spans[pair, 0], spans[pair, 1], squares[pair], known, pair, schedule, i,
            models, scores,
        )  # fmt: skip


@wp.kernel
def mark(
    stride: int,
    begin: int,
    end: int,
    matches: wp.array2d[float],
    spans: wp.array2d[int],
    squares: wp.array[float],
    known: wp.array2d[wp.float64],
    kind: int,
    models: wp.array2d[wp.float64],
    # output
    inliers: wp.array[wp.uint8],
):
    for i in range(begin + wp.tid(), end, stride):
        mark_pair(kind, matches, spans[i, 0], spans[i, 1], squares[i], known, i, models, inliers)
