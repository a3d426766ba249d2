"""The choice among hypotheses by the evidence that each explains, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive, scratch

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i64_1 = ti.types.ndarray(dtype=ti.i64, ndim=1)


@primitive
def rank_modes(
    modes: np.ndarray, evidence: np.ndarray, least: int, ranked: np.ndarray, savings: np.ndarray
) -> None:
    """List the R modes with most evidence, at least `least`, and that evidence (R,).

    Of equal evidence the first wins, by row, column and scale. Rows of `ranked` (R, 4) behind the
    last are 0; modes of density 0 are not ranked.
    """
    _rank(modes, evidence, least, ranked, savings)


@ti.func
def _is_before(modes: ti.template(), i: ti.i32, t: ti.i32) -> ti.i32:
    """Return 1 if mode i is before mode t by row, column and scale."""
    found = ti.cast(modes[i, 2] < modes[t, 2], ti.i32)
    if modes[i, 1] != modes[t, 1]:
        found = ti.cast(modes[i, 1] < modes[t, 1], ti.i32)
    if modes[i, 0] != modes[t, 0]:
        found = ti.cast(modes[i, 0] < modes[t, 0], ti.i32)
    return found


@ti.kernel
def _rank(
    modes: i32_2,
    evidence: i32_1,
    least: ti.i32,
    # outputs
    ranked: i32_2,  # (R, 4)
    savings: i32_1,
):
    for r in range(savings.shape[0]):
        savings[r] = 0
        for k in range(4):
            ranked[r, k] = 0
    for t in range(modes.shape[0]):
        own = evidence[t]
        if modes[t, 3] > 0 and own >= least:
            rank = 0
            for i in range(modes.shape[0]):
                if modes[i, 3] > 0:
                    if evidence[i] > own or (evidence[i] == own and _is_before(modes, i, t) == 1):
                        rank += 1
            if rank < savings.shape[0]:
                for k in range(4):
                    ranked[rank, k] = modes[t, k]
                savings[rank] = own


@primitive
def explain_modes(
    ranked: np.ndarray,
    savings: np.ndarray,
    shared: np.ndarray,
    starts: np.ndarray,
    least: int,
    found: np.ndarray,
) -> None:
    """Choose hypotheses by minimum description length.

    Each of R ranked modes saves its evidence, and loses what it shares (R, R) with those chosen
    before, if that is positive. The one with most evidence left is chosen next, while it has at
    least `least`; the first wins a tie. The first row of `found` (R + 1, 4) is the number of modes
    chosen, and the number of votes at the end of `starts`; then come the row, column, scale and
    remaining evidence of each, and zeros.
    """
    left = scratch(savings.shape, np.int64)
    _explain(ranked, savings, shared, starts, least, left, found)


@ti.kernel
def _explain(
    ranked: i32_2,
    savings: i32_1,
    shared: i32_2,
    starts: i32_1,
    least: ti.i32,
    # outputs
    left: i64_1,
    found: i32_2,  # (R + 1, 4)
):
    for _ in range(1):
        count = 0
        for i in range(savings.shape[0]):
            left[i] = savings[i]
            count += ti.cast(ranked[i, 3] > 0, ti.i32)
        for i in range(found.shape[0]):
            for k in range(4):
                found[i, k] = 0
        chosen = 0
        best = 0
        while best >= 0:
            best = -1
            most = ti.cast(least, ti.i64) - 1
            for i in range(count):
                if left[i] > most:
                    most = left[i]
                    best = i
            if best >= 0:
                chosen += 1
                for k in range(3):
                    found[chosen, k] = ranked[best, k]
                found[chosen, 3] = ti.cast(most, ti.i32)
                for i in range(count):
                    left[i] -= ti.max(shared[i, best], 0)
                left[best] = ti.cast(least, ti.i64) - 1
        found[0, 0] = chosen
        found[0, 1] = starts[starts.shape[0] - 1]
