#include "_paraboloid.h"
#pragma once

// needs MOVES
// The end of the fit to an extremum, on CUDA: its bit is set, and counted in its row.
struct Moves {
    // Bits and numbers are the same in any order.
    static __noinline__ void keep(const wp::int64* octave, const int4 cell, float contrast,
                                  float edge, int margin, int* words, int* counts) {
        size_t word = 0, row = 0;
        for (int o = 0; o < cell.x; ++o, octave += 4) {
            word += (size_t)(octave[1] * octave[2]) * ((octave[3] + 31) / 32);
            row += (size_t)(octave[1] * octave[2]);
        }
        const int height = (int)octave[2], width = (int)octave[3];
        Paraboloid found{(const float*)octave[0], (int)octave[1], height, width};
        int s = cell.y, y = cell.z, x = cell.w;
        if (!found.fit(contrast, edge, margin, MOVES, s, y, x)) return;
        const size_t line = (size_t)(s - 1) * height + y;
        const int bit = 1 << (x % 32);
        int* const place = words + word + line * ((width + 31) / 32) + x / 32;
        if (!(atomicOr(place, bit) & bit)) atomicAdd(counts + row + line, 1);
    }
};
