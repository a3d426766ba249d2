"""Votes for lines on the CPU: one thread per slab of angles, each with its own histograms.

A point (y, x) votes at angle t for the bin of rho = x cos t + y sin t (Duda and Hart, "Use of the
Hough transformation to detect lines and curves in pictures", CACM 1972). Rho is in fixed point:
``(x C + y S + O) >> shift``.
"""

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ANGLES = 8  # angles at a time
GROUP = 16  # angles whose histograms are written together
POINTS = 64  # points at a time


def _vote(weighted: bool) -> wp.Kernel:
    """Return the kernel for votes of 1, or of the points' weights."""

    @_native.kernel(
        "_votes_cpu.h", ANGLES=ANGLES, GROUP=GROUP, POINTS=POINTS, WEIGHTED=int(weighted)
    )
    def vote(
        slab: int,
        first: int,
        last: int,
        points: wp.array2d[int],  # (capacity, 2)
        starts: wp.array[int],  # its last element is the end of the points; see _votes_cpu.h
        cosine: wp.array[int],  # (T + up to 7,)
        sine: wp.array[int],
        offset: wp.array[wp.int64],
        shift: int,
        weights: wp.array[int],  # (capacity,), if they count
        # scratch
        lines: wp.array2d[int],  # (slabs GROUP, R)
        # outputs
        votes: wp.array2d[int],  # (R, T)
    ): ...

    return vote


def _vote_directed(weighted: bool) -> wp.Kernel:
    """Return the kernel for votes of 1, or of the points' weights."""

    @_native.kernel("_votes_cpu.h", WEIGHTED=int(weighted))
    def vote_directed(
        slab: int,
        first: int,
        last: int,
        points: wp.array2d[int],  # (capacity, 2)
        starts: wp.array[int],
        windows: wp.array2d[int],  # (capacity, 2): first angle, number of angles
        cosine: wp.array[int],  # (T + up to 7,)
        sine: wp.array[int],
        offset: wp.array[wp.int64],
        shift: int,
        weights: wp.array[int],  # (capacity,), if they count
        # outputs
        votes: wp.array2d[int],  # (R, T)
    ): ...

    return vote_directed


votes = {weighted: _vote(weighted) for weighted in (False, True)}
directed_votes = {weighted: _vote_directed(weighted) for weighted in (False, True)}
