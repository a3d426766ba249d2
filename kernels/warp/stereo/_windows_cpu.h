#include "costs/_sums_cpu.h"
#include "_winner.h"

// needs TILE, LOW_HALVES, HIGH_HALVES, FIRST_BLOCKS, LAST_BLOCKS
// The sums of a row are transposed: each disparity gets its own line with successive pixels, and
// the winner is found for LANES pixels at once. Places without a disparity or outside the image
// hold 65535, which no sum reaches; a line has `edge` such places on both sides.
void match_windows(int slab, int first, int last, wp::array_t<ELEMENT> left,
                   wp::array_t<ELEMENT> right, int count, Windows windows, WinnerRule rule,
                   WindowWork work, WinnerArrays winners, wp::array_t<int> right_index) {
    typedef WindowRow::sums sums;
    typedef SUM part
        __attribute__((vector_size(TILE * sizeof(SUM)), aligned(sizeof(SUM)), may_alias));
    const int width = left.shape[1], start = windows.first, radius_x = windows.radius_x;
    const WindowRow row = {(const ELEMENT*)left.data,
                           (const ELEMENT*)right.data,
                           left.shape[0],
                           width,
                           left.shape[2],
                           windows.octets,
                           start,
                           count,
                           windows.radius_y,
                           radius_x,
                           work.lines.data + (size_t)slab * work.lines.shape[1],
                           work.columns.data + (size_t)slab * work.columns.shape[1]};
    const sums none = (SUM)65535 - (sums){};
    sums lane;
    for (int k = 0; k < LANES; ++k) lane[k] = (SUM)k;
    const int edge = LANES, turned = (width + TILE - 1) / TILE * TILE, line = work.line;
    SUM* const tile = work.turned.data + (size_t)slab * work.turned.shape[1];
    SUM* const lines_of_sums = tile + TILE * LANES;
    for (int k = 0; k < row.range(); ++k)
        for (int i = 0; i < line; ++i)
            if (i < edge || i >= edge + turned) lines_of_sums[(size_t)k * line + i] = 65535;
    // Transpose TILE pixels, beginning at x: within blocks of 8 x 8, then the blocks. Each round
    // interleaves halves, which exchanges the first bit of the row number with the last bit of the
    // column number.
    const auto turn = [&](int x, int chunk) {
        for (int begin = 0; begin < LANES; begin += TILE) {
            part rows[TILE];
            for (int group = 0; group < TILE; group += 8) {
                part a[8], b[8];
#pragma clang loop unroll(full)
                for (int i = 0; i < 8; ++i) a[i] = *(part*)(tile + (group + i) * LANES + begin);
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
                SUM* const to = lines_of_sums + (size_t)(chunk + begin + i) * line + edge + x;
                *(part*)to = __builtin_shufflevector(e, g, FIRST_BLOCKS);
                *(part*)(to + (size_t)8 * line) = __builtin_shufflevector(e, g, LAST_BLOCKS);
                *(part*)(to + (size_t)16 * line) = __builtin_shufflevector(f, h, FIRST_BLOCKS);
                *(part*)(to + (size_t)24 * line) = __builtin_shufflevector(f, h, LAST_BLOCKS);
            }
        }
    };
    const auto keep = [&](const sums& total, int x, int chunk) __attribute__((always_inline)) {
        const int at = x - 2 * radius_x, row = at % TILE;
        sums* const to = (sums*)(tile + row * LANES);
        if (chunk + LANES <= count)
            *to = total;
        else
            *to = lane + (SUM)chunk < (SUM)count ? total : none;
        if (row == TILE - 1 || at == width - 1) {
            for (int i = row + 1; i < TILE; ++i) *(sums*)(tile + i * LANES) = none;
            turn(at - row, chunk);
        }
    };
    for (int y = first; y < last; ++y) {
        sum_windows(row, y, y == first, keep);
        for (int begin = 0; begin < width; begin += LANES) {
            const SUM* const here = lines_of_sums + edge + begin;
            sums least = none, place = none, second = none;
            for (int k = 0; k < count; ++k) {
                const sums sum = *(const sums*)(here + (size_t)k * line);
                const sums less = __builtin_elementwise_min(sum, least);
                place = less == least ? place : (SUM)k - (sums){};
                least = less;
            }
            for (int k = 0; k < count; ++k) {
                const sums sum = *(const sums*)(here + (size_t)k * line);
                second = (SUM)(k + 1) - place <= (SUM)2 ? second
                                                        : __builtin_elementwise_min(sum, second);
            }
            SUM found[3][LANES];
            *(sums*)found[0] = place;
            *(sums*)found[1] = least;
            *(sums*)found[2] = second;
            const int end = width - begin < LANES ? width - begin : LANES;
            for (int i = 0; i < end; ++i) {
                const int k = found[0][i], best = found[1][i], rival = found[2][i];
                const bool inner = k > 0 && k + 1 < count;
                const SUM* const at = here + (size_t)k * line + i;
                const int before = inner ? at[-line] - best : 0,
                          after = inner ? at[line] - best : 0;
                const Winner winner = {k, best, rival, rival == 65535, inner, before, after};
                const size_t p = (size_t)y * width + begin + i;
                winner.store(start, rule.subpixel, rule.uniqueness, winners.index.data + p,
                             winners.disparity.data + p, winners.cost.data + p,
                             winners.confidence.data + p);
            }
        }
        // The same for the right image: at disparity k, its pixel x matches left pixel x + start +
        // k.
        for (int begin = 0; begin < width; begin += LANES) {
            const int from = begin + start;
            const int low = from < -edge ? -edge - from : 0;
            const int high = width - from < count ? width - from : count;
            sums least = none, place = none;
            for (int k = low; k < high; ++k) {
                const sums sum = *(const sums*)(lines_of_sums + (size_t)k * line + edge + from + k);
                const sums less = __builtin_elementwise_min(sum, least);
                place = less == least ? place : (SUM)k - (sums){};
                least = less;
            }
            const int end = width - begin < LANES ? width - begin : LANES;
            SUM found[2][LANES];
            *(sums*)found[0] = place;
            *(sums*)found[1] = least;
            int* const to = right_index.data + (size_t)y * width + begin;
            for (int i = 0; i < end; ++i) to[i] = found[1][i] == 65535 ? -1 : found[0][i];
        }
    }
}
