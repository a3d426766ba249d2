"""Votes for lines on CUDA: a block has one angle, a share of the points, and its own histogram.

A point (y, x) votes at angle t for the bin of rho = x cos t + y sin t, in fixed point as on the
CPU. The histogram is in shared memory; if this is too small for all bins of rho, a block has a part
of them. The histograms are then added, and transposed so that the angles are along the rows. With
directions, a point has few votes, which a thread adds one by one.
"""

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = 256  # threads of a block; Warp's own
TILE = 32  # bins and angles of a square that is transposed; the lanes of a warp
SMALL, LARGE = 6016, 12032  # bins of a histogram: 24 and 48 KB, minus 1 KB that CUDA reserves


def _vote(size: int, weighted: bool) -> wp.Kernel:
    """Return the kernel for histograms of `size` bins, and votes of 1 or of the points' weights."""

    @_native.kernel("_votes_cuda.cu", SIZE=size, WEIGHTED=int(weighted))
    def vote(
        points: wp.array2d[int],  # (capacity, 2)
        starts: wp.array[int],  # its last element is the number of points
        cosine: wp.array[int],  # (T,) or longer
        sine: wp.array[int],
        offset: wp.array[wp.int64],
        shift: int,
        parts: int,  # how many parts of the bins there are
        weights: wp.array[int],  # (capacity,), if they count
        images: int,
        # outputs
        shares: wp.array3d[int],  # (N shares, T, R)
    ): ...

    return vote


votes = {
    (size, weighted): _vote(size, weighted) for size in (SMALL, LARGE) for weighted in (False, True)
}


@_native.kernel("_votes_cuda.cu", TILE=TILE)
def add_up(
    shares: wp.array3d[int],  # (N shares, T, R)
    # outputs
    votes: wp.array3d[int],  # (N, R, T)
): ...


@wp.kernel
def clear(
    # outputs
    votes: wp.array[int],  # (N R T,)
):
    votes[wp.tid()] = 0


@wp.kernel
def vote_directed(
    points: wp.array2d[int],  # (capacity, 2)
    starts: wp.array[int],
    windows: wp.array2d[int],  # (capacity, 2): first angle, number of angles
    cosine: wp.array[int],  # (T,) or longer
    sine: wp.array[int],
    offset: wp.array[wp.int64],
    shift: int,
    weighted: bool,
    weights: wp.array[int],  # (capacity,), if they count
    threads: int,
    # outputs
    votes: wp.array3d[int],  # (N, R, T)
):
    # A thread takes points at a constant stride, because the host may not know their number.
    i = wp.tid()
    height = (starts.shape[0] - 1) // votes.shape[0]  # rows of an image, if there are several
    while i < starts[starts.shape[0] - 1]:
        row = points[i, 0]
        image = int(0)
        if votes.shape[0] > 1:
            image = row // height
        y = wp.int64(row - image * height)
        x = wp.int64(points[i, 1])
        vote = wp.where(weighted, weights[wp.where(weighted, i, 0)], 1)
        angle = windows[i, 0]
        for _k in range(windows[i, 1]):
            rho = x * wp.int64(cosine[angle]) + y * wp.int64(sine[angle]) + offset[angle]
            wp.atomic_add(votes, image, int(rho >> wp.int64(shift)), angle, vote)
            angle += 1
            if angle == votes.shape[2]:
                angle = 0
        i += threads
