"""Votes for lines on CUDA: a block has one angle, a share of the points, and its own histogram.

The histogram lies in shared memory; where that is too small for all bins of rho, a block has a
part of them. The histograms are then added up, and turned to have the angles along the rows.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = 256  # threads; Warp's own
TILE = 32  # of the turning
SMALL, LARGE = 6016, 12032  # bins of a histogram: 24 and 48 KB, less 1 KB that CUDA keeps

# A thread takes four points at a time, two by one load of 16 bytes.
_VOTE = """
    #define WEIGHT(i) (WEIGHTED)
    __shared__ int histogram[SIZE];
    const int t = threadIdx.x, threads = blockDim.x;
    const int angles = shares.shape[1], bins = shares.shape[2];
    const int angle = blockIdx.x % angles, rest = blockIdx.x / angles;
    const int low = rest % parts * SIZE, share = rest / parts, count = shares.shape[0];
    const int width = bins - low < SIZE ? bins - low : SIZE;
    for (int i = t; i < width; i += threads) histogram[i] = 0;
    __syncthreads();
    const int number = starts.data[starts.shape[0] - 1];
    const int begin = (int)((long long)number * share / count) & ~1;
    const int end = share + 1 == count ? number
                                       : (int)((long long)number * (share + 1) / count) & ~1;
    const long long c = cosine.data[angle], s = sine.data[angle];
    const long long o = offset.data[angle] - ((long long)low << shift);
    const int4* pairs = reinterpret_cast<const int4*>(points.data);
    int i = begin + 2 * t;
    for (; i + 2 * threads + 1 < end; i += 4 * threads) {
        const int4 a = pairs[i / 2], b = pairs[i / 2 + threads];
        const unsigned int at[4] = {
            (unsigned int)((a.y * c + (a.x * s + o)) >> shift),
            (unsigned int)((a.w * c + (a.z * s + o)) >> shift),
            (unsigned int)((b.y * c + (b.x * s + o)) >> shift),
            (unsigned int)((b.w * c + (b.z * s + o)) >> shift)};
        #pragma unroll
        for (int k = 0; k < 4; ++k)
            if (at[k] < width)
                atomicAdd(histogram + at[k], WEIGHT(i + k % 2 + 2 * threads * (k / 2)));
    }
    for (; i < end; i += 2 * threads)
        for (int j = i; j < i + 2 && j < end; ++j) {
            const int y = points.data[2 * j], x = points.data[2 * j + 1];
            const unsigned int at = (unsigned int)((x * c + (y * s + o)) >> shift);
            if (at < width) atomicAdd(histogram + at, WEIGHT(j));
        }
    __syncthreads();
    int* to = shares.data + ((size_t)share * angles + angle) * bins + low;
    for (int i = t; i < width; i += threads) to[i] = histogram[i];
    #undef WEIGHT
"""


def _vote(size: int, weight: str) -> wp.Kernel:
    """Return the kernel for histograms of `size` bins; `weight` is that of point i, in C."""

    @wp.func_native(_VOTE.replace("SIZE", str(size)).replace("WEIGHTED", weight))
    def vote_in_a_block(
        points: wp.array2d[int],
        starts: wp.array[int],
        cosine: wp.array[int],
        sine: wp.array[int],
        offset: wp.array[wp.int64],
        shift: int,
        parts: int,
        weights: wp.array[int],
        shares: wp.array3d[int],
    ): ...

    @wp.kernel
    def vote(
        points: wp.array2d[int],  # (capacity, 2)
        starts: wp.array[int],  # its last element is the number of points
        cosine: wp.array[int],  # (T,) or longer
        sine: wp.array[int],
        offset: wp.array[wp.int64],
        shift: int,
        parts: int,  # of the bins
        weights: wp.array[int],  # (capacity,)
        # outputs
        shares: wp.array3d[int],  # (shares, T, R)
    ):
        vote_in_a_block(points, starts, cosine, sine, offset, shift, parts, weights, shares)

    return vote


votes = {
    (size, weighted): _vote(size, "weights.data[i]" if weighted else "1")
    for size in (SMALL, LARGE)
    for weighted in (False, True)
}


@wp.func_native("""
    // A block turns a square of votes; its eight warps take a row of it each.
    __shared__ int square[32][33];
    const int angles = votes.shape[1], bins = votes.shape[0];
    const int across = (bins + 31) / 32;
    const int bin = blockIdx.x % across * 32, angle = blockIdx.x / across * 32;
    const int lane = threadIdx.x % 32, row = threadIdx.x / 32;
    const size_t size = (size_t)angles * bins;
    for (int k = row; k < 32; k += 8)
        if (angle + k < angles && bin + lane < bins) {
            const int* from = shares.data + (size_t)(angle + k) * bins + bin + lane;
            int sum = 0;
            for (int share = 0; share < shares.shape[0]; ++share) sum += from[share * size];
            square[k][lane] = sum;
        }
    __syncthreads();
    for (int k = row; k < 32; k += 8)
        if (bin + k < bins && angle + lane < angles)
            votes.data[(size_t)(bin + k) * angles + angle + lane] = square[lane][k];
""")
def add_and_turn(shares: wp.array3d[int], votes: wp.array2d[int]): ...


@wp.kernel
def add_up(
    shares: wp.array3d[int],  # (shares, T, R)
    # outputs
    votes: wp.array2d[int],  # (R, T)
):
    add_and_turn(shares, votes)


@wp.kernel
def clear(
    # outputs
    votes: wp.array2d[int],  # (R, T)
):
    i = wp.tid()
    bin = i // votes.shape[1]
    votes[bin, i - bin * votes.shape[1]] = 0


@wp.kernel
def vote_directed(
    points: wp.array2d[int],  # (capacity, 2)
    starts: wp.array[int],
    windows: wp.array2d[int],  # (capacity, 2)
    cosine: wp.array[int],  # (T,) or longer
    sine: wp.array[int],
    offset: wp.array[wp.int64],
    shift: int,
    weighted: bool,
    weights: wp.array[int],  # (capacity,)
    threads: int,
    # outputs
    votes: wp.array2d[int],  # (R, T)
):
    # One thread a point, or every so many points, as the host may not know how many there are.
    i = wp.tid()
    while i < starts[starts.shape[0] - 1]:
        y = wp.int64(points[i, 0])
        x = wp.int64(points[i, 1])
        vote = wp.where(weighted, weights[wp.where(weighted, i, 0)], 1)
        angle = windows[i, 0]
        for _k in range(windows[i, 1]):
            rho = x * wp.int64(cosine[angle]) + y * wp.int64(sine[angle]) + offset[angle]
            wp.atomic_add(votes, int(rho >> wp.int64(shift)), angle, vote)
            angle += 1
            if angle == votes.shape[1]:
                angle = 0
        i += threads
