"""Votes for ellipses on CUDA, one block a pair of points, its histogram in shared memory."""

import warp as wp

from cvkern.kernels.codes.hough import MAX_BINS

from ._third_point import THIRD

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = 256
PAIRS = 1 << 22  # of one launch: their threads are counted in 32 bits

_PAIR = f"""
    __shared__ int histogram[{MAX_BINS} + 1];
    __shared__ long long top;
    const int count = points.shape[1], pair = first + blockIdx.x;
    if (pair >= count * count) return;  // the whole block
    const int i = pair / count, j = pair - i * count;
    const float* row = points.data;
    const float* column = row + count;
    const float* down = column + count;
    const float* along = down + count;
    const float ey = row[j] - row[i], ex = column[j] - column[i];
    const float whole = ey * ey + ex * ex;
    bool paired = (j < i) & (whole >= least) & (whole <= most);
    if (directed & paired) {{
        const float one = down[i] * ex - along[i] * ey, other = down[j] * ex - along[j] * ey;
        paired = (one * one <= turn * whole) & (other * other <= turn * whole);
    }}
    if (!paired) {{  // the whole block
        if (threadIdx.x == 0) votes.data[pair] = axes.data[pair] = 0;
        return;
    }}
    if (threadIdx.x == 0) top = 0;
    for (int b = threadIdx.x; b <= bins; b += {BLOCK}) histogram[b] = 0;
    __syncthreads();
    const float my = row[j] + row[i], mx = column[j] + column[i];
    for (int k = threadIdx.x; k < count; k += {BLOCK}) {{
        const float y = row[k], x = column[k], ny = down[k], nx = along[k];
        {THIRD}
        if (counts) atomicAdd(histogram + (int)(wp::sqrt(square) * per_bin + 0.5f), 1);
    }}
    __syncthreads();
    // The most votes, of equals the least bin: the largest of votes over bins from the end.
    long long best = 0;
    for (int b = threadIdx.x; b < bins; b += {BLOCK}) {{
        const long long here = (long long)histogram[b] << 32 | ({MAX_BINS} - b);
        best = here > best ? here : best;
    }}
    atomicMax(&top, best);
    __syncthreads();
    if (threadIdx.x == 0) {{
        votes.data[pair] = (int)(top >> 32);
        axes.data[pair] = top >> 32 ? {MAX_BINS} - (int)(top & 0xffffffff) : 0;
    }}
"""


@wp.func_native(_PAIR)
def pair_votes(
    first: int,
    points: wp.array2d[float],
    least: float,
    most: float,
    narrow: float,
    wide: float,
    per_bin: float,
    bins: int,
    directed: bool,
    turn: float,
    votes: wp.array2d[int],
    axes: wp.array2d[int],
): ...


@wp.kernel
def vote_pairs(
    first: int,
    points: wp.array2d[float],  # (4, N)
    least: float,
    most: float,
    narrow: float,
    wide: float,
    per_bin: float,
    bins: int,
    directed: bool,
    turn: float,
    # outputs
    votes: wp.array2d[int],  # (N, N)
    axes: wp.array2d[int],  # (N, N)
):
    pair_votes(first, points, least, most, narrow, wide, per_bin, bins, directed, turn, votes, axes)
