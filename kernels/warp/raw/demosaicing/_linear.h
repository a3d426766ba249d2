// Fixed filters of 5 x 5 samples, PART pixels at once. Rows and columns beyond the image are those
// mirrored at its border, which have the same colours.

#include "../_mirror.h"

// needs TYPE, PART, SHARP, INTEGRAL, HIGHEST
void interpolate(int row, int left, int right, wp::array_t<TYPE> raw, int red_row, int red_column,
                 wp::array_t<TYPE> colours) {
#pragma clang fp contract(off)
    const int height = raw.shape[0], width = raw.shape[1];
    float near[5][PART + 4], own[PART], other[PART], green[PART];
    const bool blue = (row & 1) != red_row;  // whether it is a row of blue and green
    const int column = blue ? 1 - red_column : red_column;
    for (int begin = left; begin < right; begin += PART) {
        const int count = right - begin < PART ? right - begin : PART;
        const bool inner = begin >= 2 && begin + count + 2 <= width;
        for (int k = 0; k < 5; ++k) {
            const TYPE* from = raw.data + (size_t)Mirror::at(row + k - 2, height) * width;
            if (inner)
                for (int i = 0; i < count + 4; ++i) near[k][i] = (float)from[begin + i - 2];
            else
                for (int i = 0; i < count + 4; ++i)
                    near[k][i] = (float)from[Mirror::at(begin + i - 2, width)];
        }
#pragma clang loop vectorize(assume_safety)
        for (int i = 0; i < count; ++i) {
            const float c = near[2][i + 2];
            const float h = near[2][i + 1] + near[2][i + 3], v = near[1][i + 2] + near[3][i + 2];
            const float d = (near[1][i + 1] + near[1][i + 3]) + (near[3][i + 1] + near[3][i + 3]);
            const float far_h = near[2][i] + near[2][i + 4];
            const float far_v = near[0][i + 2] + near[4][i + 2];
            float cross = 0.25f * (h + v), across = 0.5f * h, down = 0.5f * v, corners = 0.25f * d;
            if (SHARP) {
                cross = 0.125f * ((4.0f * c + 2.0f * (h + v)) - (far_h + far_v));
                across = 0.125f * (((5.0f * c + 4.0f * h) - (d + far_h)) + 0.5f * far_v);
                down = 0.125f * (((5.0f * c + 4.0f * v) - (d + far_v)) + 0.5f * far_h);
                corners = 0.125f * ((6.0f * c + 2.0f * d) - 1.5f * (far_h + far_v));
            }
            const bool chroma = ((begin + i) & 1) == column;
            own[i] = chroma ? c : across;
            green[i] = chroma ? cross : c;
            other[i] = chroma ? corners : down;
        }
        const auto rounded = [](float value) {
            if (!INTEGRAL) return (TYPE)value;
            const float most = (float)HIGHEST;
            value += 0.5f;
            return (TYPE)(int)(value < 0.0f ? 0.0f : value > most ? most : value);
        };
        TYPE* to = colours.data + ((size_t)row * width + begin) * 3;
        const float *red = blue ? other : own, *last = blue ? own : other;
        TYPE values[3][PART];
        for (int i = 0; i < count; ++i) {
            values[0][i] = rounded(red[i]);
            values[1][i] = rounded(green[i]);
            values[2][i] = rounded(last[i]);
        }
        for (int i = 0; i < count; ++i)
            for (int k = 0; k < 3; ++k) to[3 * i + k] = values[k][i];
    }
}
