// Green from the differences along rows and columns, PART pixels at once.
#include "_settled.h"

// needs PART, BORDER, SMOOTH, FLAT, TINY
void _green(int row, int left, int right, int red_row, int red_column, wp::array_t<float> planes) {
#pragma clang fp contract(off)
    const int y = row + BORDER, s = planes.shape[2];
    const size_t plane = (size_t)planes.shape[1] * s;
    float texture[2][PART + 4], slope[2][PART + 4], change[2][PART + 4];
    const int column = (y & 1) != red_row ? 1 - red_column : red_column;
    for (int begin = left + BORDER; begin < right + BORDER; begin += PART) {
        const int rest = right + BORDER - begin, count = rest < PART ? rest : PART;
        for (int i = 0; i < count + 4; ++i)
            for (int k = 0; k < 2; ++k) texture[k][i] = slope[k][i] = change[k][i] = 0.0f;
        for (int dy = -2; dy <= 2; ++dy) {
            const float* p = planes.data + (size_t)(y + dy) * s + begin - 2;
            for (int k = 0; k < 2; ++k) {
                const float* d = p + (1 + k) * plane;
                const int n = k ? s : 1;
                float *t = texture[k], *g = slope[k], *c = change[k];
#pragma clang loop vectorize(assume_safety)
                for (int i = 0; i < count + 4; ++i) {
                    const float fine = 0.5f * p[i] - 0.25f * (p[i - 2 * n] + p[i + 2 * n]);
                    const float after = (d[i + n] + d[i + 3 * n]) + 2.0f * d[i + 2 * n];
                    const float before = (d[i - 3 * n] + d[i - n]) + 2.0f * d[i - 2 * n];
                    const float rise = 0.125f * (after - before);
                    t[i] += fine * fine;
                    g[i] += rise * rise;
                    c[i] += wp::abs(d[i + n] - d[i - n]);
                }
            }
        }
        const float* p = planes.data + (size_t)y * s + begin;
        float* to = planes.data + 3 * plane + (size_t)y * s + begin;
        const auto sum = [](const float* x) { return (((x[0] + x[1]) + x[2]) + x[3]) + x[4]; };
#pragma clang loop vectorize(assume_safety)
        for (int i = 0; i < count; ++i) {
            float weights = 0.0f, total = 0.0f;
            for (int k = 0; k < 2; ++k) {
                const float* d = p + (1 + k) * plane + i;
                const int n = k ? s : 1;
                const float mean =
                    0.0625f * (((d[-3 * n] + d[3 * n]) + 2.0f * (d[-2 * n] + d[2 * n])) +
                               (3.0f * (d[-n] + d[n]) + 4.0f * d[0]));
                const float t = sum(texture[k] + i), g = sum(slope[k] + i);
                const float c = 0.04f * sum(change[k] + i);
                const float own = g * g;
                const float share = own / ((own + (float)SMOOTH * (t * t)) + (float)TINY);
                const float found = mean + (d[0] - mean) * share;
                const float w = 1.0f / ((c * c + (float)FLAT * (p[i] * p[i])) + (float)TINY);
                weights += w;
                total += w * found;
            }
            const bool chroma = ((begin + i) & 1) == column;
            to[i] = chroma ? settled(p[i] + total / weights) : p[i];
        }
    }
}
