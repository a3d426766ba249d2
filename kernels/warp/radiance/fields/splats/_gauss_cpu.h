#pragma once

// needs TILE, SHOWN, FAINT, MOST
// A row of a tile: the pixels at which a splat is seen, and its opacity there.
struct SplatRow {
    typedef float Lanes __attribute__((ext_vector_type(TILE)));
    typedef int Integers __attribute__((ext_vector_type(TILE)));

    Lanes dx, alpha;
    float dy;
    Integers on;

    // Return e^x for x up to 0, by the operations of `exponential` of _placing.py.
    static Lanes exponential(Lanes x) {
#pragma clang fp contract(off)
        const Lanes t = __builtin_elementwise_max(x, (Lanes)(-87.0f)) * 1.4426950408889634f;
        const Lanes n = __builtin_elementwise_floor(t + 0.5f);
        const Lanes f = t - n;
        Lanes p = 1.5252734e-5f * f + 1.5403530e-4f;
        p = p * f + 1.3333558e-3f;
        p = p * f + 9.6181291e-3f;
        p = p * f + 5.5504109e-2f;
        p = p * f + 2.4022651e-1f;
        p = p * f + 6.9314718e-1f;
        p = p * f + 1.0f;
        return p * (Lanes)((__builtin_convertvector(n, Integers) + 127) << 23);
    }

    // Look at a splat `s` from the row `row`, whose pixels begin at `left`; `through` is their light.
    SplatRow(const float* s, int row, int left, Lanes through, float stop) {
#pragma clang fp contract(off)
        Lanes column;
        for (int k = 0; k < TILE; ++k) column[k] = left + k;
        dx = s[0] - column;
        dy = s[1] - row;
        const Lanes e = -0.5f * (s[2] * dx * dx + s[4] * dy * dy) - s[3] * dx * dy;
        alpha = s[5] * exponential(__builtin_elementwise_min(e, (Lanes)(0.0f)));
        alpha = __builtin_elementwise_min(alpha, (Lanes)(MOST));
        on = (alpha >= FAINT) & (through > stop);
    }

    // Return the first and the last row of a tile that begins at `top` in which a splat is seen.
    static int first(const float* s, int top) {
        const float above = s[1] - s[11] - top;
        return above > 0.0f ? (int)above : 0;
    }
    static int last(const float* s, int top) {
        const float below = s[1] + s[11] - top;
        return below < TILE - 1 ? (int)below : TILE - 1;
    }
    // Return whether light is left in some pixel of a tile.
    static bool alive(const Lanes* through, float stop) {
        Lanes most = through[0];
        for (int r = 1; r < TILE; ++r) most = __builtin_elementwise_max(most, through[r]);
        return __builtin_reduce_max(most) > stop;
    }
};
