"""Robust fits on the CPU: a thread takes a slab of groups of hypotheses, or of models.

The loops over matches (_lanes_cpu.h) are native, because they are vector code of 32 matches. Each
kind of model has kernels of its own, so that the first fit compiles the code of its model only.
"""

from functools import lru_cache
from typing import NamedTuple

import warp as wp

from cvkern.kernels.codes.geometry import (
    FLAT,
    GROUP,
    NO_COST,
    PREVIEW,
    Model,
)
from cvkern.kernels.warp import _native

_FILE = "_robust_cpu.h"


class Kernels(NamedTuple):
    """The kernels of a kind of model."""

    propose: wp.Kernel
    refine: wp.Kernel
    mark: wp.Kernel


@lru_cache
def kernels(kind: int) -> Kernels:
    """Return the kernels of a `Model`, which are a module of their own."""
    module = wp.get_module(f"{__name__}.{Model(kind).name.lower()}")
    wp.set_module_options({"enable_backward": False, "fuse_fp": False}, module)

    @_native.func_native(
        _FILE, KIND=int(kind), GROUP=GROUP, PREVIEW=PREVIEW, NO_COST=NO_COST, FLAT=FLAT
    )
    def best_of_group(
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

    @_native.func_native(_FILE, KIND=int(kind))
    def improve(
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

    @_native.func_native(_FILE, KIND=int(kind))
    def mark_pair(
        matches: wp.array2d[float],
        start: int,
        count: int,
        square: float,
        known: wp.array2d[wp.float64],
        at: int,
        models: wp.array2d[wp.float64],
        inliers: wp.array[wp.uint8],
    ): ...

    @wp.kernel(module=module)
    def propose(
        stride: int,
        begin: int,
        end: int,
        matches: wp.array2d[float],
        spans: wp.array2d[int],
        squares: wp.array[float],
        known: wp.array2d[wp.float64],
        pairs: wp.array[int],
        seed: int,
        first: int,
        # outputs
        models: wp.array3d[float],
        costs: wp.array2d[int],
    ):
        groups = costs.shape[1]
        for i in range(begin + wp.tid(), end, stride):
            pair = pairs[i // groups]
            best_of_group(
                seed, first + (i % groups) * wp.static(GROUP), matches,
                spans[pair, 0], spans[pair, 1], squares[pair], known, pair, i, models, costs,
            )  # fmt: skip

    @wp.kernel(module=module)
    def refine(
        stride: int,
        begin: int,
        end: int,
        matches: wp.array2d[float],
        spans: wp.array2d[int],
        squares: wp.array[float],
        known: wp.array2d[wp.float64],
        pairs: wp.array[int],
        schedule: wp.array[float],
        # outputs
        models: wp.array3d[wp.float64],
        scores: wp.array3d[int],
    ):
        for i in range(begin + wp.tid(), end, stride):
            pair = pairs[i // scores.shape[1]]
            improve(
                matches, spans[pair, 0], spans[pair, 1], squares[pair], known, pair, schedule, i,
                models, scores,
            )  # fmt: skip

    @wp.kernel(module=module)
    def mark(
        stride: int,
        begin: int,
        end: int,
        matches: wp.array2d[float],
        spans: wp.array2d[int],
        squares: wp.array[float],
        known: wp.array2d[wp.float64],
        models: wp.array2d[wp.float64],
        # output
        inliers: wp.array[wp.uint8],
    ):
        for i in range(begin + wp.tid(), end, stride):
            mark_pair(matches, spans[i, 0], spans[i, 1], squares[i], known, i, models, inliers)

    return Kernels(propose, refine, mark)
