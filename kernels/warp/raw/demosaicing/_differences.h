// Differences between green and the other colour of a line, along rows or columns, LANES lines and
// PART pixels at once. The letters are those of the Taichi set.
#include "_fit.h"
#include "_settled.h"

// needs PART, LANES, PRIOR, REACH
void _differences(int row, int left, int right, int vertical, int red_row, int red_column,
                  wp::array_t<float> planes) {
#pragma clang fp contract(off)
    enum { SIZE = PART + 2 * REACH };
    const int height = planes.shape[1], width = planes.shape[2];
    const size_t plane = (size_t)height * width;
    const int lines = vertical ? width : height;
    const size_t along = vertical ? width : 1, across = vertical ? 1 : width;
    const int first = row * LANES;
    const int count = lines - first < LANES ? lines - first : LANES;
    float p[SIZE][LANES], q[SIZE][LANES], u[SIZE][LANES], v[SIZE][LANES];
    float even[3][SIZE][LANES], odd[3][SIZE][LANES], r[SIZE][LANES];
    const float seventh = 1.0f / 7.0f, sixth = 1.0f / 6.0f;
    const auto evens = [](const auto& x, int i, int l) {
        return (((((x[i - 6][l] + x[i - 4][l]) + x[i - 2][l]) + x[i][l]) + x[i + 2][l]) +
                x[i + 4][l]) +
               x[i + 6][l];
    };
    const auto odds = [](const auto& x, int i, int l) {
        return ((((x[i - 5][l] + x[i - 3][l]) + x[i - 1][l]) + x[i + 1][l]) + x[i + 3][l]) +
               x[i + 5][l];
    };
    float uv[SIZE][LANES], vv[SIZE][LANES], uu[SIZE][LANES];
    float pp[SIZE][LANES], pq[SIZE][LANES], qq[SIZE][LANES];
    for (int begin = left; begin < right; begin += PART) {
        const int some = right - begin < PART ? right - begin : PART;
        const int size = some + 2 * REACH;
        const float* from = planes.data + (size_t)first * across + (size_t)begin * along;
        for (int i = 0; i < size; ++i)
            for (int l = 0; l < LANES; ++l)
                p[i][l] = from[(size_t)i * along + (size_t)(l < count ? l : 0) * across];
        for (int i = 1; i < size - 1; ++i)
            for (int l = 0; l < LANES; ++l) q[i][l] = 0.5f * (p[i - 1][l] + p[i + 1][l]);
        for (int i = 7; i < size - 7; ++i)
            for (int l = 0; l < LANES; ++l) {
                u[i][l] = p[i][l] - evens(p, i, l) * seventh;
                v[i][l] = q[i][l] - evens(q, i, l) * seventh;
            }
        for (int i = 1; i < size - 1; ++i)
            for (int l = 0; l < LANES; ++l) {
                pp[i][l] = p[i][l] * p[i][l];
                pq[i][l] = p[i][l] * q[i][l];
                qq[i][l] = q[i][l] * q[i][l];
                uv[i][l] = u[i][l] * v[i][l];
                vv[i][l] = v[i][l] * v[i][l];
                uu[i][l] = u[i][l] * u[i][l];
            }
        for (int i = 13; i < size - 13; ++i)
            for (int l = 0; l < LANES; ++l) {
                const Fit e(evens(p, i, l) * seventh, evens(q, i, l) * seventh,
                            evens(uv, i, l) * seventh, evens(vv, i, l) * seventh,
                            evens(uu, i, l) * seventh, evens(pp, i, l) * seventh,
                            evens(pq, i, l) * seventh, evens(qq, i, l) * seventh, (float)PRIOR);
                even[0][i][l] = e.w;
                even[1][i][l] = e.wa;
                even[2][i][l] = e.wb;
            }
        for (int i = 13; i < size - 13; ++i)
            for (int l = 0; l < LANES; ++l) {
                const Fit o(odds(p, i, l) * sixth, odds(q, i, l) * sixth, odds(uv, i, l) * sixth,
                            odds(vv, i, l) * sixth, odds(uu, i, l) * sixth, odds(pp, i, l) * sixth,
                            odds(pq, i, l) * sixth, odds(qq, i, l) * sixth, (float)PRIOR);
                odd[0][i][l] = o.w;
                odd[1][i][l] = o.wa;
                odd[2][i][l] = o.wb;
            }
        for (int i = 19; i < size - 19; ++i)
            for (int l = 0; l < LANES; ++l) {
                const float w = evens(even[0], i, l) + odds(odd[0], i, l);
                const float a = evens(even[1], i, l) + odds(odd[1], i, l);
                const float b = evens(even[2], i, l) + odds(odd[2], i, l);
                r[i][l] = p[i][l] - settled((a * q[i][l] + b) / w);
            }
        float* to = planes.data + (1 + vertical) * plane + (size_t)first * across +
                    (size_t)(begin + REACH) * along;
        for (int i = REACH; i < size - REACH; ++i) {
            float d[LANES];
            const int at = begin + i;
            for (int l = 0; l < LANES; ++l) {
                const float w = evens(odd[0], i, l) + odds(even[0], i, l);
                const float a = evens(odd[1], i, l) + odds(even[1], i, l);
                const float b = evens(odd[2], i, l) + odds(even[2], i, l);
                const float found =
                    settled((a * p[i][l] + b) / w + 0.5f * (r[i - 1][l] + r[i + 1][l]));
                const bool green = (at + first + l + red_row + red_column) & 1;
                d[l] = green ? p[i][l] - found : found - p[i][l];
            }
            for (int l = 0; l < count; ++l)
                to[(size_t)(i - REACH) * along + (size_t)l * across] = d[l];
        }
    }
}
