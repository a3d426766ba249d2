// The steps that interpolate red or blue beside green, whose samples are at (row, column) of cells.
// Planes: samples, results in 1 and 2, green in 3, then what the steps hand on. With FEW steps, those
// that add up windows are left out.
#include "_fit.h"
#include "_settled.h"

// needs PART, PRIOR, STEADY, FEW, DEVIATIONS, WINDOWS, TENTATIVE, DIAGONAL
void _chroma(int row, int left, int right, int step, int margin, int own_row, int own_column,
             int result, wp::array_t<float> planes) {
#pragma clang fp contract(off)
    const int y = row + margin, s = planes.shape[2];
    const size_t plane = (size_t)planes.shape[1] * s;
    const float* p = planes.data + (size_t)y * s;
    const float* g = p + 3 * plane;
    float* u = planes.data + 4 * plane + (size_t)y * s;
    float *v = u + plane, *w = v + plane, *tentative = w + 3 * plane;
    const bool here = (y & 1) == own_row;
    left += margin;
    right += margin;
    if (step == DEVIATIONS) {
        if (!here) return;
        const float ninth = 1.0f / 9.0f;
        const auto mean = [=](const float* x) {
            float columns[3];
            for (int k = 0; k < 3; ++k)
                columns[k] = (x[2 * k - 2 - 2 * s] + x[2 * k - 2]) + x[2 * k - 2 + 2 * s];
            return ((columns[0] + columns[1]) + columns[2]) * ninth;
        };
        for (int x = left + ((left & 1) != own_column); x < right; x += 2) {
            u[x] = p[x] - mean(p + x);
            v[x] = g[x] - mean(g + x);
        }
    } else if (!FEW && step == WINDOWS) {
        enum { COLUMNS = PART / 2 + 5, SUMS = 8 };
        float sums[SUMS][COLUMNS];
        const int rows = here ? 3 : 4, top = here ? -2 : -3;
        for (int begin = left; begin < right; begin += PART) {
            const int count = right - begin < PART ? right - begin : PART;
            const int first = begin - 3 + (((begin - 3) & 1) != own_column);
            const int columns = (begin + count + 3 - first) / 2 + 1;
            for (int k = 0; k < SUMS; ++k)
                for (int j = 0; j < columns; ++j) sums[k][j] = 0.0f;
            for (int r = 0; r < rows; ++r) {
                const long long at = (long long)(top + 2 * r) * s + first;
#pragma clang loop vectorize(assume_safety)
                for (int j = 0; j < columns; ++j) {
                    const float a = p[at + 2 * j], b = g[at + 2 * j];
                    const float c = u[at + 2 * j], d = v[at + 2 * j];
                    sums[0][j] += a;
                    sums[1][j] += b;
                    sums[2][j] += c * d;
                    sums[3][j] += d * d;
                    sums[4][j] += c * c;
                    sums[5][j] += a * a;
                    sums[6][j] += a * b;
                    sums[7][j] += b * b;
                }
            }
            for (int parity = 0; parity < 2; ++parity) {
                // Pixels on columns of samples see three of them, those between see four.
                const bool on = parity == 0;
                const float share = 1.0f / (float)(rows * (on ? 3 : 4));
                const int x0 = begin + (((begin & 1) == own_column) != on);
                const int before = ((on ? x0 - 2 : x0 - 3) - first) / 2;
#pragma clang loop vectorize(assume_safety)
                for (int j = 0; j < (begin + count - x0 + 1) / 2; ++j) {
                    float m[SUMS];
                    for (int k = 0; k < SUMS; ++k) {
                        const float* c = sums[k] + before + j;
                        const float three = (c[0] + c[1]) + c[2];
                        m[k] = (on ? three : three + c[3]) * share;
                    }
                    const Fit fit(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], (float)PRIOR);
                    const int x = x0 + 2 * j;
                    w[x] = fit.w;
                    w[x + plane] = fit.wa;
                    w[x + 2 * plane] = fit.wb;
                }
            }
        }
    } else if (!FEW && step == TENTATIVE) {
        float sums[3][PART + 6];
        for (int begin = left; begin < right; begin += PART) {
            const int count = right - begin < PART ? right - begin : PART;
            for (int k = 0; k < 3; ++k) {
                const float* from = w + k * plane + begin - 3;
#pragma clang loop vectorize(assume_safety)
                for (int i = 0; i < count + 6; ++i) {
                    const float a = (from[i - 3 * s] + from[i - 2 * s]) + from[i - s];
                    const float b = (a + from[i]) + from[i + s];
                    sums[k][i] = (b + from[i + 2 * s]) + from[i + 3 * s];
                }
            }
            const auto sum = [](const float* x) {
                return (((((x[0] + x[1]) + x[2]) + x[3]) + x[4]) + x[5]) + x[6];
            };
#pragma clang loop vectorize(assume_safety)
            for (int i = 0; i < count; ++i) {
                const int x = begin + i;
                const float t =
                    settled((sum(sums[1] + i) * g[x] + sum(sums[2] + i)) / sum(sums[0] + i));
                tentative[x] = t;
                u[x] = p[x] - t;
            }
        }
    } else {
        // What the lines leave between two pairs of neighbours, along `d` and along `e`. A pair weighs
        // as the inverse fourth power of its change, here and at the four nearest pixels of the same
        // kind; changes that are small beside green do not count.
        const auto between = [=](int x, int d, int e, int a, int b) {
            const float sixth = 1.0f / 6.0f;
            const auto change = [=](int i, int n) {
                const float c = u[i - n] - u[i + n];
                return c < 0.0f ? -c : c;
            };
            const auto pooled = [=](int n) {
                const float around =
                    (change(x - a, n) + change(x - b, n)) + (change(x + b, n) + change(x + a, n));
                return (2.0f * change(x, n) + around) * sixth;
            };
            const float one = pooled(d), other = pooled(e);
            const float flat = STEADY * (g[x] < 0.0f ? -g[x] : g[x]);
            const float scale = 1.0f / (((one + other) + flat) + TINY);
            const auto fourth = [=](float value) {
                const float squared = (value * scale) * (value * scale);
                return squared * squared;
            };
            const float least = fourth(flat) + TINY;
            const float along = fourth(one) + least, across = fourth(other) + least;
            const float first = 0.5f * (u[x - d] + u[x + d]);
            const float second = 0.5f * (u[x - e] + u[x + e]);
            return second + across / (along + across) * (first - second);
        };
        float* to = planes.data + result * plane + (size_t)y * s;
        const int beside = left + ((left & 1) == own_column);
        const int on = left + ((left & 1) != own_column);
        if (step == DIAGONAL) {
            if (here) return;
#pragma clang loop vectorize(assume_safety)
            for (int x = beside; x < right; x += 2) u[x] = between(x, s + 1, s - 1, 2 * s, 2);
            return;
        }
        const int first = here ? beside : on, rest = here ? on : beside;
#pragma clang loop vectorize(assume_safety)
        for (int x = first; x < right; x += 2)
            to[x] = settled(tentative[x] + between(x, 1, s, s + 1, s - 1));
        if (here)
            for (int x = rest; x < right; x += 2) to[x] = p[x];
        else
            for (int x = rest; x < right; x += 2) to[x] = settled(tentative[x] + u[x]);
    }
}
