// Green from the differences along rows and columns on CUDA, with the sums of _green.h in the same
// order. A warp goes down a strip of columns, of which each lane has two, and keeps the rows that it
// needs; the outer lanes only help.
#include "_settled.h"

// needs BORDER, SMOOTH, FLAT, TINY, LONG
void green_strips(int red_row, int red_column, wp::array_t<float> planes) {
    enum { WIDE = 60, ROWS = 5 };
    struct Two {
        float v[2];
    };
    struct Energies {  // texture, slope and change: along rows, then along columns
        Two v[6];
    };
    const int height = planes.shape[1], s = planes.shape[2], lane = threadIdx.x % 32;
    const size_t plane = (size_t)height * s;
    const int strips = (s - 2 * BORDER + WIDE - 1) / WIDE;
    const int chunks = (height - 2 * BORDER + LONG - 1) / LONG;
    const auto read = [](const float* from) { return Two{{from[0], from[1]}}; };
    for (int item = (blockIdx.x * blockDim.x + threadIdx.x) / 32; item < strips * chunks;
         item += gridDim.x * blockDim.x / 32) {
        const int begin = BORDER + item / strips * LONG;
        const int end = begin + LONG < height - BORDER ? begin + LONG : height - BORDER;
        const int x = BORDER + item % strips * WIDE + 2 * (lane - 1);
        const bool own = lane > 0 && lane < 31 && x < s - BORDER;
        // Lanes far beyond the row, which nobody needs, read its end.
        const float* samples = planes.data + (x < s - 6 ? x : s - 6);
        const float *level = samples + plane, *upright = level + plane;
        // Rows v - 2 to v + 2 of samples, and v - 5 to v + 3 of differences along columns.
        Two p[ROWS], d[9];
        Energies rows[ROWS];
#pragma unroll
        for (int k = 1; k < ROWS; ++k) p[k] = read(samples + (size_t)(begin - 5 + k) * s);
#pragma unroll
        for (int k = 1; k < 9; ++k) d[k] = read(upright + (size_t)(begin - 8 + k) * s);
        for (int first = begin - 2; first < end + 2; first += ROWS) {
#pragma unroll
            for (int step = 0; step < ROWS; ++step) {
                const int v = first + step, y = v - 2;
                if (y >= end) break;
#pragma unroll
                for (int k = 0; k < ROWS - 1; ++k) {
                    p[k] = p[k + 1];
                    rows[k] = rows[k + 1];
                }
#pragma unroll
                for (int k = 0; k < 8; ++k) d[k] = d[k + 1];
                p[4] = read(samples + (size_t)(v + 2) * s);
                d[8] = read(upright + (size_t)(v + 3) * s);
                const float *sample = samples + (size_t)v * s, *beside = level + (size_t)v * s;
                const float near[6] = {sample[-2], sample[-1], p[2].v[0],
                                       p[2].v[1],  sample[2],  sample[3]};
                float line[8];
#pragma unroll
                for (int k = 0; k < 8; ++k) line[k] = beside[k - 3];
#pragma unroll
                for (int n = 0; n < 2; ++n) {
                    const auto energy = [&](int k, float before, float here, float after, float a,
                                            float b, float c, float e, float f, float g) {
                        const float fine = 0.5f * here - 0.25f * (before + after);
                        const float later = (e + g) + 2.0f * f, earlier = (a + c) + 2.0f * b;
                        const float rise = 0.125f * (later - earlier);
                        rows[4].v[k].v[n] = fine * fine;
                        rows[4].v[k + 1].v[n] = rise * rise;
                        rows[4].v[k + 2].v[n] = fabsf(e - c);
                    };
                    energy(0, near[n], near[n + 2], near[n + 4], line[n], line[n + 1], line[n + 2],
                           line[n + 4], line[n + 5], line[n + 6]);
                    energy(3, p[0].v[n], p[2].v[n], p[4].v[n], d[2].v[n], d[3].v[n], d[4].v[n],
                           d[6].v[n], d[7].v[n], d[8].v[n]);
                }
                if (y < begin) continue;
                // The sums about the lane's pixel of a colour other than green.
                const bool second = (y & 1) != red_row ? !red_column : red_column;
                float sums[6];
#pragma unroll
                for (int k = 0; k < 6; ++k) {
                    float a[2];
#pragma unroll
                    for (int n = 0; n < 2; ++n) {
                        const float three =
                            (rows[0].v[k].v[n] + rows[1].v[k].v[n]) + rows[2].v[k].v[n];
                        a[n] = (three + rows[3].v[k].v[n]) + rows[4].v[k].v[n];
                    }
                    const float before = __shfl_up_sync(0xffffffffu, a[1], 1);
                    const float after = __shfl_down_sync(0xffffffffu, a[0], 1);
                    if (second)
                        sums[k] = (((before + a[0]) + a[1]) + after) +
                                  __shfl_down_sync(0xffffffffu, a[1], 1);
                    else
                        sums[k] =
                            (((__shfl_up_sync(0xffffffffu, a[0], 1) + before) + a[0]) + a[1]) +
                            after;
                }
                if (!own) continue;
                const float here = second ? p[0].v[1] : p[0].v[0];
                float weights = 0.0f, total = 0.0f;
#pragma unroll
                for (int k = 0; k < 2; ++k) {
                    float q[7];
#pragma unroll
                    for (int i = 0; i < 7; ++i)
                        q[i] = k ? (second ? d[i].v[1] : d[i].v[0])
                                 : level[(size_t)y * s + second + i - 3];
                    const float mean = 0.0625f * (((q[0] + q[6]) + 2.0f * (q[1] + q[5])) +
                                                  (3.0f * (q[2] + q[4]) + 4.0f * q[3]));
                    const float t = sums[3 * k], g = sums[3 * k + 1], c = 0.04f * sums[3 * k + 2];
                    const float power = g * g;
                    const float share = power / ((power + (float)SMOOTH * (t * t)) + (float)TINY);
                    const float found = mean + (q[3] - mean) * share;
                    const float w = 1.0f / ((c * c + (float)FLAT * (here * here)) + (float)TINY);
                    weights += w;
                    total += w * found;
                }
                const float green = settled(here + total / weights);
                float* to = planes.data + 3 * plane + (size_t)y * s + x;
                to[0] = second ? p[0].v[0] : green;
                if (x + 1 < s - BORDER) to[1] = second ? green : p[0].v[1];
            }
        }
    }
}
