"""Votes for ellipses on the CPU, one thread a slab of first points.

What is done to each third point is C (`wp.func_native`), because all but the last step becomes
vector code as it stands. _votes_cuda.py has the same in C for CUDA.
"""

import warp as wp

from ._third_point import THIRD

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Of 64 third points at once, the bin; those that count for none share the last.
_PAIRS = f"""
    #pragma clang fp contract(off)
    const int count = points.shape[1], bins = histograms.shape[1] - 1;
    const float* row = points.data;
    const float* column = row + count;
    const float* down = column + count;
    const float* along = down + count;
    int* histogram = histograms.data + (size_t)slab * (bins + 1);
    for (int j = 0; j < count; ++j) {{
        int best = 0, at = 0;
        const float ey = row[j] - row[i], ex = column[j] - column[i];
        const float whole = ey * ey + ex * ex;
        bool paired = (j < i) & (whole >= least) & (whole <= most);
        if (directed & paired) {{
            const float one = down[i] * ex - along[i] * ey, other = down[j] * ex - along[j] * ey;
            paired = (one * one <= turn * whole) & (other * other <= turn * whole);
        }}
        if (paired) {{
            const float my = row[j] + row[i], mx = column[j] + column[i];
            for (int b = 0; b <= bins; ++b) histogram[b] = 0;
            for (int begin = 0; begin < count; begin += 64) {{
                const int n = count - begin < 64 ? count - begin : 64;
                int bin[64];
                #pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < n; ++k) {{
                    const float y = row[begin + k], x = column[begin + k];
                    const float ny = down[begin + k], nx = along[begin + k];
                    {THIRD}
                    bin[k] = counts ? (int)(wp::sqrt(square) * per_bin + 0.5f) : bins;
                }}
                for (int k = 0; k < n; ++k) ++histogram[bin[k]];
            }}
            for (int b = 0; b < bins; ++b)
                if (histogram[b] > best) best = histogram[b], at = b;
        }}
        votes.data[(size_t)i * count + j] = best;
        axes.data[(size_t)i * count + j] = at;
    }}
"""


@wp.func_native(_PAIRS)
def pairs_with(
    slab: int,
    i: int,
    points: wp.array2d[float],
    least: float,
    most: float,
    narrow: float,
    wide: float,
    per_bin: float,
    directed: bool,
    turn: float,
    histograms: wp.array2d[int],
    votes: wp.array2d[int],
    axes: wp.array2d[int],
): ...


@wp.kernel
def vote_pairs(
    slab: int,
    first: int,
    last: int,
    points: wp.array2d[float],  # (4, N)
    least: float,
    most: float,
    narrow: float,
    wide: float,
    per_bin: float,
    directed: bool,
    turn: float,
    # scratch
    histograms: wp.array2d[int],  # (slabs, bins + 1)
    # outputs
    votes: wp.array2d[int],  # (N, N)
    axes: wp.array2d[int],  # (N, N)
):
    for i in range(first, last):
        pairs_with(
            slab, i, points, least, most, narrow, wide, per_bin, directed, turn, histograms,
            votes, axes,
        )  # fmt: skip
