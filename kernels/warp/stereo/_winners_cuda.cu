#include "_winner.h"

// needs TYPE, MOST, LANES, VECTOR, BLOCK
// LANES threads take one pixel, VECTOR costs at a time.
void pick(wp::array_t<TYPE> costs, WinnerRule rule, WinnerArrays winners) {
    const unsigned ALL = 0xffffffffu;
    const WIDE most = MOST;
    const int depth = costs.shape[2], lane = threadIdx.x % LANES;
    const unsigned pixels = (unsigned)costs.shape[0] * costs.shape[1];
    const unsigned number = blockIdx.x * (BLOCK / LANES) + threadIdx.x / LANES;
    const unsigned pixel = min(number, pixels - 1);  // the threads of a warp stay together
    const TYPE* here = costs.data + (long long)pixel * depth;
    const auto load = [&](int d, TYPE* c) {
        if (VECTOR > 1)
            *reinterpret_cast<uint4*>(c) = *reinterpret_cast<const uint4*>(here + d);
        else
            c[0] = here[d];
    };
    WIDE best = most, second = most;
    int k = depth;
    for (int d = lane * VECTOR; d < depth; d += LANES * VECTOR) {
        __align__(16) TYPE c[VECTOR];
        load(d, c);
#pragma unroll
        for (int j = 0; j < VECTOR; ++j) {
            if (c[j] < best) {
                best = c[j];
                k = d + j;
            }
        }
    }
#pragma unroll
    for (int o = LANES / 2; o > 0; o >>= 1) {
        const WIDE other = __shfl_xor_sync(ALL, best, o);
        const int other_k = __shfl_xor_sync(ALL, k, o);
        if (other < best || (other == best && other_k < k)) {
            best = other;
            k = other_k;
        }
    }
    if (k == depth) k = 0;  // all costs are infinite
    for (int d = lane * VECTOR; d < depth; d += LANES * VECTOR) {
        __align__(16) TYPE c[VECTOR];
        load(d, c);
#pragma unroll
        for (int j = 0; j < VECTOR; ++j)
            if (abs(d + j - k) > 1) second = min(second, (WIDE)c[j]);
    }
#pragma unroll
    for (int o = LANES / 2; o > 0; o >>= 1) second = min(second, __shfl_xor_sync(ALL, second, o));
    if (lane != 0 || number >= pixels) return;
    const bool inner = k > 0 && k < depth - 1;
    // A cost that is NaN counts as infinite.
    const WIDE before = inner && here[k - 1] < most ? (WIDE)here[k - 1] : most;
    const WIDE after = inner && here[k + 1] < most ? (WIDE)here[k + 1] : most;
    const WIDE a = inner ? before - best : (WIDE)0, b = inner ? after - best : (WIDE)0;
    const bool alone = k < 2 && k > depth - 3;
    const Winner winner = {k, best, second, alone, inner, a, b};
    winner.store(rule.first, rule.subpixel, rule.uniqueness, winners.index.data + pixel,
                 winners.disparity.data + pixel, winners.cost.data + pixel,
                 winners.confidence.data + pixel);
}

// needs TYPE, MOST, BLOCK
// A block takes a tile of BLOCK right pixels, in steps of 32 disparities. A step needs the costs of
// BLOCK + 32 columns of the left image, which are loaded row by row into shared memory.
void pick_right(wp::array_t<TYPE> costs, int first, wp::array_t<int> index) {
    const int width = costs.shape[1], depth = costs.shape[2];
    const int tiles = (width + BLOCK - 1) / BLOCK;
    const int y = blockIdx.x / tiles, begin = blockIdx.x % tiles * BLOCK;
    const TYPE* row = costs.data + (long long)y * width * depth;
    __shared__ TYPE tile[BLOCK + 32][33];
    TYPE best = 0;
    int k = -1;
    for (int base = 0; base < depth; base += 32) {
        const int lane = threadIdx.x % 32;
        for (int i = threadIdx.x / 32; i < BLOCK + 32; i += BLOCK / 32) {
            const int x = begin + first + base + i;
            if (x >= 0 && x < width && base + lane < depth)
                tile[i][lane] = row[(long long)x * depth + base + lane];
        }
        __syncthreads();
#pragma unroll 8
        for (int j = 0; j < 32; ++j) {
            const int x = begin + threadIdx.x + first + base + j;
            if (x >= 0 && x < width && base + j < depth) {
                const TYPE given = tile[threadIdx.x + j][j];
                const TYPE c = given < (TYPE)MOST ? given : (TYPE)MOST;  // NaN as well
                if (k < 0 || c < best) {
                    best = c;
                    k = base + j;
                }
            }
        }
        __syncthreads();
    }
    if (begin + threadIdx.x < width) index.data[(long long)y * width + begin + threadIdx.x] = k;
}
