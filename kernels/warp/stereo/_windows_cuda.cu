#include "costs/_hamming_cuda.h"
#include "_winner.h"

// needs WORDS, COLUMNS, BLOCK
void match(wp::array_t<wp::uint64> left, wp::array_t<wp::uint64> right, int count, Windows windows,
           WinnerRule rule, int rows, WinnerArrays winners, wp::array_t<wp::uint32> keys) {
    const int SPAN = 64 * WORDS, MOST = SPAN - 1, WARPS = BLOCK / 32;
    __shared__ unsigned columns[COLUMNS * 32 * WORDS];
    __shared__ unsigned right_keys[COLUMNS + SPAN];
    __shared__ unsigned left_words[2][COLUMNS], right_words[2][COLUMNS + SPAN];
    const unsigned ALL = 0xffffffffu;
    const int height = left.shape[0], width = left.shape[1];
    const int first = windows.first, radius_y = windows.radius_y, radius_x = windows.radius_x;
    const int thread = threadIdx.x, lane = thread % 32, warp = thread / 32;
    const int tile = COLUMNS - 2 * radius_x, tiles = (width + tile - 1) / tile;
    const int begin = blockIdx.x % tiles * tile, size = min(tile, width - begin);
    const int top = blockIdx.x / tiles * rows, bottom = min(top + rows, height);
    const int wide = size + 2 * radius_x;
    // A word is the lower half of a given element. At disparity k, place i of the right words
    // matches place i - MOST + k of the left words.
    const auto load = [&](int which, int y) {
        const size_t row = (size_t)max(0, min(height - 1, y)) * width;
        const uint2* l = (const uint2*)left.data + row;
        const uint2* r = (const uint2*)right.data + row;
        const int x = begin - radius_x;
        for (int i = thread; i < wide; i += BLOCK)
            left_words[which][i] = l[max(0, min(width - 1, x + i))].x;
        for (int i = thread; i < wide + MOST; i += BLOCK)
            right_words[which][i] = r[max(0, min(width - 1, x - first - MOST + i))].x;
    };
    const auto distances = [&](int which, int i, int k) {
        const unsigned word = left_words[which][i];
        const unsigned* others = right_words[which] + i + MOST - k;
        return Hamming::distance(word, others[0]) | Hamming::distance(word, others[-32]) << 16;
    };
    const auto least_of_warp = [&](unsigned value) {
#if __CUDA_ARCH__ >= 800
        return __reduce_min_sync(ALL, value);
#else
        for (int o = 16; o > 0; o >>= 1) value = min(value, __shfl_xor_sync(ALL, value, o));
        return value;
#endif
    };
    for (int i = thread; i < COLUMNS * 32 * WORDS; i += BLOCK) columns[i] = 0;
    for (int i = thread; i < COLUMNS + SPAN; i += BLOCK) right_keys[i] = ALL;
    for (int y = top - radius_y; y < top + radius_y; ++y) {
        load(0, y);
        __syncthreads();
        for (int i = warp; i < wide; i += WARPS)
            for (int w = 0; w < WORDS; ++w)
                columns[(i * WORDS + w) * 32 + lane] += distances(0, i, lane + 64 * w);
        __syncthreads();
    }
    for (int y = top; y < bottom; ++y) {
        load(0, y + radius_y);
        if (y > top) load(1, y - radius_y - 1);
        __syncthreads();
        for (int i = warp; i < wide; i += WARPS)
#pragma unroll
            for (int w = 0; w < WORDS; ++w) {
                unsigned change = distances(0, i, lane + 64 * w);
                if (y > top) change -= distances(1, i, lane + 64 * w);
                columns[(i * WORDS + w) * 32 + lane] += change;
            }
        __syncthreads();
        const int run = (size + WARPS - 1) / WARPS;
        const int from = min(warp * run, size), end = min(from + run, size);
        unsigned sums[WORDS];
#pragma unroll
        for (int w = 0; w < WORDS; ++w) {
            sums[w] = 0;
            for (int i = 0; i < 2 * radius_x; ++i)
                sums[w] += columns[((from + i) * WORDS + w) * 32 + lane];
        }
        for (int x = from; x < end; ++x) {
            unsigned least = ALL;
#pragma unroll
            for (int w = 0; w < WORDS; ++w) {
                sums[w] += columns[((x + 2 * radius_x) * WORDS + w) * 32 + lane];
#pragma unroll
                for (int h = 0; h < 2; ++h) {
                    const int k = lane + 64 * w + 32 * h;
                    if (k >= count) continue;
                    const unsigned key = (h ? sums[w] & 0xffff0000u : sums[w] << 16) | k;
                    least = min(least, key);
                    atomicMin(&right_keys[x + MOST - k], key);
                }
            }
            least = least_of_warp(least);
            const int at = least & 0xffff, best = least >> 16;
            unsigned second = 65535, before = 0, after = 0;
#pragma unroll
            for (int w = 0; w < WORDS; ++w)
#pragma unroll
                for (int h = 0; h < 2; ++h) {
                    const int k = lane + 64 * w + 32 * h;
                    const unsigned sum = h ? sums[w] >> 16 : sums[w] & 0xffff;
                    if (k < count && abs(k - at) > 1) second = min(second, sum);
                    if ((at - 1) / 32 == k / 32) before = sum;
                    if ((at + 1) / 32 == k / 32) after = sum;
                }
            second = least_of_warp(second);
            before = __shfl_sync(ALL, before, (at - 1) & 31);
            after = __shfl_sync(ALL, after, (at + 1) & 31);
#pragma unroll
            for (int w = 0; w < WORDS; ++w) sums[w] -= columns[(x * WORDS + w) * 32 + lane];
            if (lane != 0) continue;
            const size_t p = (size_t)y * width + begin + x;
            const bool inner = at > 0 && at + 1 < count;
            const Winner winner = {at,
                                   best,
                                   (int)second,
                                   second == 65535,
                                   inner,
                                   inner ? (int)before - best : 0,
                                   inner ? (int)after - best : 0};
            winner.store(first, rule.subpixel, rule.uniqueness, winners.index.data + p,
                         winners.disparity.data + p, winners.cost.data + p,
                         winners.confidence.data + p);
        }
        __syncthreads();
        for (int i = thread; i < size + MOST; i += BLOCK) {
            const unsigned key = right_keys[i];
            const int x = begin - first - MOST + i;
            if (key != ALL && x >= 0 && x < width)
                atomicMin((unsigned*)keys.data + (size_t)y * width + x, key);
            right_keys[i] = ALL;
        }
    }
}
