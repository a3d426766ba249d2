#include "_third_point.h"

// needs BLOCK MAX_BINS
// One block per pair of points, with its histogram in shared memory.
void vote_pairs(int first, wp::array_t<float> points, Bounds bounds, int bins,
                wp::array_t<int> votes, wp::array_t<int> axes) {
    __shared__ int histogram[MAX_BINS + 1];
    __shared__ long long top;
    const int count = points.shape[1], pair = first + blockIdx.x;
    if (pair >= count * count) return;  // the whole block
    const int i = pair / count, j = pair - i * count;
    const float *row = points.data, *column = row + count;
    const float *down = column + count, *along = down + count;
    const float turn = bounds.turn;
    const bool directed = turn >= 0.0f;
    const Axis axis(row, column, i, j);
    const float whole = axis.whole;
    bool paired = (j < i) & (whole >= bounds.least) & (whole <= bounds.most);
    if (directed & paired)
        paired = Axis::aligned(down[i], along[i], axis.ey, axis.ex, whole, turn) &
                 Axis::aligned(down[j], along[j], axis.ey, axis.ex, whole, turn);
    if (!paired) {  // the whole block
        if (threadIdx.x == 0) votes.data[pair] = axes.data[pair] = 0;
        return;
    }
    if (threadIdx.x == 0) top = 0;
    for (int b = threadIdx.x; b <= bins; b += BLOCK) histogram[b] = 0;
    __syncthreads();
    for (int k = threadIdx.x; k < count; k += BLOCK) {
        const float square = axis.minor(row[k], column[k], down[k], along[k], bounds.narrow,
                                        bounds.wide, directed, turn);
        if (square >= 0.0f)
            atomicAdd(histogram + (int)(wp::sqrt(square) * bounds.per_bin + 0.5f), 1);
    }
    __syncthreads();
    // Find the bin with most votes, the smallest of equal ones: the largest key of votes in the
    // high bits, and the bin counted from the end in the low bits.
    long long best = 0;
    for (int b = threadIdx.x; b < bins; b += BLOCK) {
        const long long here = (long long)histogram[b] << 32 | (MAX_BINS - b);
        best = here > best ? here : best;
    }
    atomicMax(&top, best);
    __syncthreads();
    if (threadIdx.x == 0) {
        votes.data[pair] = (int)(top >> 32);
        axes.data[pair] = top >> 32 ? MAX_BINS - (int)(top & 0xffffffff) : 0;
    }
}
