#include "_winner.h"

// The sums of successive pixels of a row, transposed: each disparity has its own line, and winners
// are found for LANES pixels at once. Places without a sum hold NONE, which no sum reaches; a line
// has LANES such places on both sides.
// needs LANES, TILE, LOW_HALVES, HIGH_HALVES, FIRST_BLOCKS, LAST_BLOCKS
struct Turned {
    typedef unsigned short sums __attribute__((vector_size(2 * LANES), aligned(2), may_alias));
    typedef unsigned short part __attribute__((vector_size(2 * TILE), aligned(2), may_alias));
    enum { NONE = 65535 };

    unsigned short* lines;  // the first pixel of the first line
    int pitch, count;

    // Transpose the sums of TILE pixels at TILE disparities, which `from` holds pixel by pixel, to
    // the lines from disparity k and pixel x on: within blocks of 8 x 8, then the blocks. Each
    // round interleaves halves, which exchanges the first bit of the row number with the last bit
    // of the column number.
    void turn(const unsigned short* from, int step, int k, int x) const {
        part rows[TILE];
        for (int group = 0; group < TILE; group += 8) {
            part a[8], b[8];
#pragma clang loop unroll(full)
            for (int i = 0; i < 8; ++i) a[i] = *(const part*)(from + (group + i) * step);
#pragma clang loop unroll(full)
            for (int round = 0; round < 3; ++round) {
#pragma clang loop unroll(full)
                for (int i = 0; i < 4; ++i) {
                    b[2 * i] = __builtin_shufflevector(a[i], a[i + 4], LOW_HALVES);
                    b[2 * i + 1] = __builtin_shufflevector(a[i], a[i + 4], HIGH_HALVES);
                }
#pragma clang loop unroll(full)
                for (int i = 0; i < 8; ++i) a[i] = b[i];
            }
#pragma clang loop unroll(full)
            for (int i = 0; i < 8; ++i) rows[group + i] = a[i];
        }
        for (int i = 0; i < 8; ++i) {
            const part a = rows[i], b = rows[i + 8], c = rows[i + 16], d = rows[i + 24];
            const part e = __builtin_shufflevector(a, c, FIRST_BLOCKS);
            const part f = __builtin_shufflevector(a, c, LAST_BLOCKS);
            const part g = __builtin_shufflevector(b, d, FIRST_BLOCKS);
            const part h = __builtin_shufflevector(b, d, LAST_BLOCKS);
            unsigned short* const to = lines + (size_t)(k + i) * pitch + x;
            *(part*)to = __builtin_shufflevector(e, g, FIRST_BLOCKS);
            *(part*)(to + (size_t)8 * pitch) = __builtin_shufflevector(e, g, LAST_BLOCKS);
            *(part*)(to + (size_t)16 * pitch) = __builtin_shufflevector(f, h, FIRST_BLOCKS);
            *(part*)(to + (size_t)24 * pitch) = __builtin_shufflevector(f, h, LAST_BLOCKS);
        }
    }

    // The smallest sum of LANES places and its first index, among the indices from `low` to `high`;
    // at index k the first place is `from` + k step.
    void least(const unsigned short* from, int step, int low, int high, sums& sum,
               sums& index) const {
        sum = index = (unsigned short)NONE - (sums){};
        for (int k = low; k < high; ++k) {
            const sums less =
                __builtin_elementwise_min(*(const sums*)(from + (long long)k * step), sum);
            index = less == sum ? index : (unsigned short)k - (sums){};
            sum = less;
        }
    }

    // The same for LANES pixels of the right image, of which the first one matches pixel x + k at
    // index k; the lines hold `pixels` pixels.
    void least_of_right(int x, int pixels, sums& sum, sums& index) const {
        const int low = x < -LANES ? -LANES - x : 0;
        least(lines + x, pitch + 1, low, pixels - x < count ? pixels - x : count, sum, index);
    }
};

// Store the winners of `number` <= LANES pixels from x on; p is the place of the first one.
const auto store_winners = [](const Turned& turned, int x, int number, const auto& rule,
                              const auto& to, size_t p) {
    typedef Turned::sums sums;
    const int pitch = turned.pitch, count = turned.count;
    const unsigned short* const here = turned.lines + x;
    sums sum, index, rival = (unsigned short)Turned::NONE - (sums){};
    turned.least(here, pitch, 0, count, sum, index);
    for (int k = 0; k < count; ++k) {
        const sums lower =
            __builtin_elementwise_min(*(const sums*)(here + (size_t)k * pitch), rival);
        rival = (unsigned short)(k + 1) - index <= (unsigned short)2 ? rival : lower;
    }
    unsigned short place[LANES], best[LANES], second[LANES], before[LANES], after[LANES];
    *(sums*)place = index;
    *(sums*)best = sum;
    *(sums*)second = rival;
    for (int i = 0; i < number; ++i) {
        const int k = place[i], beside = k > 0 && k + 1 < count ? pitch : 0;
        const unsigned short* const at = here + (size_t)k * pitch + i;
        before[i] = at[-beside];
        after[i] = at[beside];
    }
    const int first = rule.first, subpixel = rule.subpixel, uniqueness = rule.uniqueness;
    int* const to_index = to.index.data + p;
    float* const to_disparity = to.disparity.data + p;
    float* const to_cost = to.cost.data + p;
    float* const to_confidence = to.confidence.data + p;
#pragma clang loop vectorize(assume_safety)
    for (int i = 0; i < number; ++i) {
        const int k = place[i], c = best[i], r = second[i];
        const bool inner = k > 0 && k + 1 < count;
        const Winner winner = {k, c, r, r == Turned::NONE, inner, before[i] - c, after[i] - c};
        winner.store(first, subpixel, uniqueness, to_index + i, to_disparity + i, to_cost + i,
                     to_confidence + i);
    }
};
