"""The choice among hypotheses by the evidence that each explains, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_each, scratch
from cvkern.kernels.warp._zeros import clear

from . import _choices_cuda as cuda

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def rank_modes(
    modes: wp.array, evidence: wp.array, least: int, ranked: wp.array, savings: wp.array
) -> None:
    """List the R modes with most evidence, at least `least`, and that evidence (R,).

    Of equal evidence the first wins, by row, column and scale. Rows of `ranked` (R, 4) behind the
    last are 0; modes of density 0 are not ranked.
    """
    clear(ranked)
    clear(savings)
    count = modes.shape[0]
    launch_each(_rank, count, count, [modes, evidence, least], [ranked, savings])


def explain_modes(
    ranked: wp.array,
    savings: wp.array,
    shared: wp.array,
    starts: wp.array,
    least: int,
    found: wp.array,
) -> None:
    """Choose hypotheses by minimum description length.

    Each of R ranked modes saves its evidence, and loses what it shares (R, R) with those chosen
    before, if that is positive. The one with most evidence left is chosen next, while it has at
    least `least`; the first wins a tie. The first row of `found` (R + 1, 4) is the number of modes
    chosen, and the number of votes at the end of `starts`; then come the row, column, scale and
    remaining evidence of each, and zeros.
    """
    clear(found)
    inputs = [ranked, savings, shared, starts, least]
    if found.device.is_cuda:
        launch(cuda.explain, cuda.THREADS, inputs, [found], cuda.THREADS)
        return
    left = scratch("recognition.left", savings.shape, wp.int64, found.device)
    launch_each(_explain, 1, 1, inputs, [left, found])


@wp.func
def is_before(modes: wp.array2d[int], i: int, t: int) -> bool:
    """Tell whether mode i is before mode t by row, column and scale."""
    if modes[i, 0] != modes[t, 0]:
        return modes[i, 0] < modes[t, 0]
    if modes[i, 1] != modes[t, 1]:
        return modes[i, 1] < modes[t, 1]
    return modes[i, 2] < modes[t, 2]


@wp.kernel
def _rank(
    stride: int,
    first: int,
    last: int,
    modes: wp.array2d[int],  # (T, 4)
    evidence: wp.array[int],
    least: int,
    # outputs
    ranked: wp.array2d[int],  # (R, 4)
    savings: wp.array[int],
):
    for t in range(first + wp.tid(), last, stride):
        own = evidence[t]
        if modes[t, 3] > 0 and own >= least:
            rank = int(0)
            for i in range(modes.shape[0]):
                if modes[i, 3] > 0:
                    other = evidence[i]
                    if other > own or (other == own and is_before(modes, i, t)):
                        rank += 1
            if rank < savings.shape[0]:
                for k in range(4):
                    ranked[rank, k] = modes[t, k]
                savings[rank] = own


@wp.kernel
def _explain(
    stride: int,
    first: int,
    last: int,
    ranked: wp.array2d[int],  # (R, 4)
    savings: wp.array[int],
    shared: wp.array2d[int],  # (R, R)
    starts: wp.array[int],
    least: int,
    # outputs
    left: wp.array[wp.int64],  # (R,): work space
    found: wp.array2d[int],  # (R + 1, 4)
):
    count = int(0)
    for i in range(ranked.shape[0]):
        left[i] = wp.int64(savings[i])
        if ranked[i, 3] > 0:
            count += 1
    chosen = int(0)
    best = int(0)
    while best >= 0:
        best = int(-1)
        for i in range(count):
            if left[i] >= wp.int64(least) and (best < 0 or left[i] > left[wp.max(best, 0)]):
                best = i
        if best >= 0:
            chosen += 1
            for k in range(3):
                found[chosen, k] = ranked[best, k]
            found[chosen, 3] = int(left[best])
            for i in range(count):
                left[i] = left[i] - wp.int64(wp.max(shared[i, best], 0))
            left[best] = wp.int64(least) - wp.int64(1)
    found[0, 0] = chosen
    found[0, 1] = starts[starts.shape[0] - 1]
