#include "../_winner.h"
#include "_total_cuda.h"

// needs DEPTH, TILE, BLOCK, NARROW
void winners(wp::array_t<PATH_TYPE> lines, int depth, WinnerRule rule, WinnerArrays found,
             wp::array_t<int> right) {
    const unsigned ALL = 0xffffffffu;
    const int PITCH = DEPTH + 16, LANES = BLOCK / TILE;  // a pitch that spreads pixels over banks
    const int TURNS = DEPTH / 2 / LANES;
    const int width = lines.shape[2], padded = lines.shape[3], chunks = padded / 16;
    const int tiles = (width + TILE - 1) / TILE;
    const int y = blockIdx.x / tiles, begin = blockIdx.x % tiles * TILE;
    const int count = min(TILE, width - begin);
    const long long row = (long long)y * width, pixels = (long long)lines.shape[1] * width;
    __shared__ uint4 shared[TILE * PITCH / 8];
    const unsigned short* sums = reinterpret_cast<const unsigned short*>(shared);
    for (int i = threadIdx.x; i < count * chunks; i += BLOCK) {
        const int pixel = i / chunks, d = i % chunks * 16;
        const long long at = (row + begin + pixel) * padded + d;
        unsigned total[8];
        Total::of_chunk(lines.data, pixels * padded, at, total);
        // No sum is 0xffff, because paths * (C + P2) is a multiple of 4 below 2^16.
        if (d + 16 > depth) {
#pragma unroll
            for (int j = 0; j < 8; ++j) {
                if (d + 2 * j >= depth) total[j] |= 0xffffu;
                if (d + 2 * j + 1 >= depth) total[j] |= 0xffff0000u;
            }
        }
        uint4* to = shared + (pixel * PITCH + d) / 8;
        to[0] = make_uint4(total[0], total[1], total[2], total[3]);
        to[1] = make_uint4(total[4], total[5], total[6], total[7]);
    }
    __syncthreads();

    // The left image. A key is a sum and its disparity, so the smallest disparity wins a tie.
    {
        const int pixel = threadIdx.x / LANES, lane = threadIdx.x % LANES;
        const unsigned short* here = sums + pixel * PITCH;
        const unsigned* pairs = reinterpret_cast<const unsigned*>(here);
        const int words = pixel < count ? padded / 2 : 0;
        unsigned key = ALL, second = ALL;
        if (NARROW && depth == DEPTH && pixel < count) {
            // Both halves of a number have a sum of 10 bits above the turn of 6 bits.
            unsigned both = ALL;
#pragma unroll
            for (int t = 0; t < TURNS; ++t)
                both = __vminu2(both, pairs[lane + t * LANES] * 64 + t * 0x10001u);
            const unsigned low = both & 0xffff, high = both >> 16;
            key = min(low >> 6 << 16 | 2 * (lane + (low & 63) * LANES),
                      high >> 6 << 16 | 2 * (lane + (high & 63) * LANES) + 1);
        } else {
            for (int w = lane; w < words; w += LANES)
                key = min(key, min(pairs[w] << 16 | 2 * w, (pairs[w] & 0xffff0000u) | 2 * w + 1));
        }
#pragma unroll
        for (int o = LANES / 2; o > 0; o >>= 1) key = min(key, __shfl_xor_sync(ALL, key, o));
        const int k = key & 0xffff;
#pragma unroll 4
        for (int w = lane; w < words; w += LANES) {
            const unsigned gap = 2 * w - k + 2;  // 1 to 3: near the winner; the next one, 0 to 2
            unsigned far = pairs[w];
            far |= gap - 1 <= 2u ? 0xffffu : 0u;
            far |= gap <= 2u ? 0xffff0000u : 0u;
            second = __vminu2(second, far);
        }
        second = min(second & 0xffff, second >> 16);
#pragma unroll
        for (int o = LANES / 2; o > 0; o >>= 1)
            second = min(second, __shfl_xor_sync(ALL, second, o));
        if (pixel < count && lane == 0) {
            const int best = key >> 16;
            const bool inner = k > 0 && k < depth - 1;
            const int before = inner ? here[k - 1] - best : 0;
            const int after = inner ? here[k + 1] - best : 0;
            const Winner winner = {k, best, (int)second, second == 0xffff, inner, before, after};
            const long long p = row + begin + pixel;
            winner.store(rule.first, rule.subpixel, rule.uniqueness, found.index.data + p,
                         found.disparity.data + p, found.cost.data + p, found.confidence.data + p);
        }
    }

    // The right image: disparity k of left column x belongs to right column x - first - k.
    for (int j = threadIdx.x; j < count + depth - 1; j += BLOCK) {
        const int x = begin - rule.first - (depth - 1) + j;
        if (x < 0 || x >= width) continue;
        const int last = min(j, count - 1);
        unsigned key = ALL;
#pragma unroll 8
        for (int i = max(0, j - (depth - 1)); i <= last; ++i) {
            const int k = i + depth - 1 - j;
            key = min(key, (unsigned)sums[i * PITCH + k] << 16 | k);
        }
        atomicMin(reinterpret_cast<unsigned*>(right.data) + row + x, key);
    }
}
