#pragma once
#include "_mirror.h"
// needs PART
// Rows of the next smaller and the next larger level of a pyramid [Burt and Adelson 1983]: taps of
// (1, 4, 6, 4, 1) / 16, mirrored at the border, down the columns first. PART values at once, from
// an even column on.
struct Pyramid {
    enum { WIDE = 2 * PART + 3, NARROW = PART / 2 + 3 };

    // How many values from `left` on are worked on: on CUDA all, so that arrays stay in registers.
    static CUDA_CALLABLE int count(int left, int right) {
#if defined(__CUDA_ARCH__)
        return PART;
#else
        return right - left < PART ? right - left : PART;
#endif
    }

    // Whether place x is one of those to be written.
    static CUDA_CALLABLE bool within(int x, int right) {
#if defined(__CUDA_ARCH__)
        return x < right;
#else
        return true;  // `count` ends before
#endif
    }

    static CUDA_CALLABLE float weigh(float a, float b, float c, float d, float e) {
#pragma clang fp contract(off)
        return (((a + e) + 4.0f * (b + d)) + 6.0f * c) * 0.0625f;
    }

    // The place in the smaller level, of m of n, that place i is the mirror image of.
    static CUDA_CALLABLE int place(int i, int m, int n) {
        if (i < 0) i = 1;
        if (i >= m) i = m - 1 - (n & 1);
        return i < 0 ? 0 : i < m ? i : m - 1;
    }

    static CUDA_CALLABLE float even(float a, float b, float c) {
#pragma clang fp contract(off)
        return ((a + c) + 6.0f * b) * 0.125f;
    }

    // `count` values of row y of the larger level, of height and width, from column left on.
    static CUDA_CALLABLE void expand(const float* from, int rows, int columns, int height,
                                     int width, int y, int left, int count, float* out) {
#pragma clang fp contract(off)
        float line[NARROW];
        const int first = left / 2 - 1, length = (count + 1) / 2 + 2;
        const float* here = from + (size_t)(y / 2) * columns;
        const float* after = from + (size_t)place(y / 2 + 1, rows, height) * columns;
        const float* before = from + (size_t)place(y / 2 - 1, rows, height) * columns;
        const bool odd = y & 1;
        const auto across = [=](int x) {
            return odd ? 0.5f * (here[x] + after[x]) : even(before[x], here[x], after[x]);
        };
#if defined(__CUDA_ARCH__)
        const bool inner = first >= 0 && first + length <= columns;
        for (int t = 0; t < length; ++t)
            line[t] = across(inner ? first + t : place(first + t, columns, width));
#else
        const int inside = columns - first < length ? columns - first : length;
        if (first < 0) line[0] = across(place(first, columns, width));
        if (odd)
            for (int t = first < 0; t < inside; ++t)
                line[t] = 0.5f * (here[first + t] + after[first + t]);
        else
            for (int t = first < 0; t < inside; ++t)
                line[t] = even(before[first + t], here[first + t], after[first + t]);
        for (int t = inside; t < length; ++t) line[t] = across(place(first + t, columns, width));
#endif
        for (int t = 0; t < (count + 1) / 2; ++t) {
            out[2 * t] = even(line[t], line[t + 1], line[t + 2]);
            out[2 * t + 1] = 0.5f * (line[t + 1] + line[t + 2]);
        }
    }
};
