// Differences between green and the other colour on CUDA, with the sums of _differences.h in the same
// order. A block works on LINES lines of SIZE pixels in shared memory, where pixels at even and at odd
// places are apart; a thread takes a pixel at an odd place and the next one, which share their windows'
// pixels. The letters are those of the Taichi set.
#include "_fit.h"
#include "_settled.h"

// needs PRIOR, REACH, LINES, SIZE, THREADS
void line_differences(int vertical, int red_row, int red_column, wp::array_t<float> planes) {
    enum { HALF = SIZE / 2 * LINES, ALL = SIZE * LINES, LONG = SIZE - 2 * REACH, SUMS = 8 };
    enum { TURNS = ((SIZE - 2 * REACH + 2) / 2 * LINES + THREADS - 1) / THREADS };
    __shared__ float samples[ALL], even[3][ALL], odd[3][ALL], rest[ALL], guide[ALL];
    const float seventh = 1.0f / 7.0f, sixth = 1.0f / 6.0f;
    const int height = planes.shape[1], width = planes.shape[2];
    const size_t plane = (size_t)height * width;
    const int lines = vertical ? width : height, length = (vertical ? height : width) - 2 * REACH;
    const size_t along = vertical ? width : 1, across = vertical ? 1 : width;
    const int parts = (length + LONG - 1) / LONG, groups = (lines + LINES - 1) / LINES;
    const int thread = threadIdx.x;
    // The place of pixel i of line l. Two pixels further on, it is LINES more.
    const auto at = [](int i, int l) { return (i & 1) * HALF + (i >> 1) * LINES + l; };
    const auto mean = [](const float* a) { return 0.5f * (a[0] + a[LINES]); };
    const auto evens = [](const float* x) {
        return (((((x[0] + x[LINES]) + x[2 * LINES]) + x[3 * LINES]) + x[4 * LINES]) +
                x[5 * LINES]) +
               x[6 * LINES];
    };
    const auto odds = [](const float* x) {
        return ((((x[0] + x[LINES]) + x[2 * LINES]) + x[3 * LINES]) + x[4 * LINES]) + x[5 * LINES];
    };
    for (int block = blockIdx.x; block < parts * groups; block += gridDim.x) {
        // Neighbours in a launch share the sectors that they read.
        const int first = (vertical ? block % groups : block / parts) * LINES;
        const int begin = (vertical ? block / groups : block % parts) * LONG;
        const float* from = planes.data + (size_t)first * across + (size_t)begin * along;
        // Pixel n of those that threads copy in turns: eight side by side are in one sector.
        const auto pixel = [&](int n, int& i, int& l) {
            i = vertical ? n / LINES : n / (8 * LINES) * 8 + n % 8;
            l = vertical ? n % LINES : n / 8 % LINES;
        };
        for (int n = thread; n < (SIZE + 7) / 8 * 8 * LINES; n += THREADS) {
            int i, l;
            pixel(n, i, l);
            if (i >= SIZE) continue;
            const bool there = begin + i < length + 2 * REACH && first + l < lines;
            samples[at(i, l)] = there ? from[(size_t)i * along + (size_t)l * across] : 0.0f;
        }
        __syncthreads();
        // Deviations of the samples and of the means of their neighbours.
        for (int n = thread; n < (SIZE - 14) * LINES; n += THREADS) {
            const int i = 7 + n / LINES, l = n % LINES;
            const float* p = samples + at(i - 6, l);
            const float* beside = samples + at(i - 7, l);
            float q[7];
#pragma unroll
            for (int k = 0; k < 7; ++k) q[k] = mean(beside + k * LINES);
            const float sum = (((((q[0] + q[1]) + q[2]) + q[3]) + q[4]) + q[5]) + q[6];
            rest[at(i, l)] = p[3 * LINES] - evens(p) * seventh;
            guide[at(i, l)] = q[3] - sum * seventh;
        }
        __syncthreads();
        // The lines of the windows about two pixels. The seven pixels of the larger window of one
        // are those of the smaller window of the other and one more.
        for (int n = thread; n < (SIZE - 26) / 2 * LINES; n += THREADS) {
            const int i = 13 + 2 * (n / LINES), l = n % LINES;
#pragma unroll
            for (int turn = 0; turn < 2; ++turn) {
                const float* p = samples + at(i - 6 + turn, l);
                const float* beside = samples + at(i - 7 + turn, l);
                const float* u = rest + at(i - 6 + turn, l);
                const float* v = guide + at(i - 6 + turn, l);
                float seven[SUMS], six[SUMS];
#pragma unroll
                for (int k = 0; k < 7; ++k) {
                    const float a = p[k * LINES], b = mean(beside + k * LINES);
                    const float c = u[k * LINES], d = v[k * LINES];
                    const float found[SUMS] = {a, b, c * d, d * d, c * c, a * a, a * b, b * b};
                    // The smaller window of the pixel after begins later, that of the pixel before
                    // ends earlier.
#pragma unroll
                    for (int m = 0; m < SUMS; ++m) {
                        seven[m] = k ? seven[m] + found[m] : found[m];
                        if (k != (turn ? 6 : 0))
                            six[m] = k > (turn ? 0 : 1) ? six[m] + found[m] : found[m];
                    }
                }
#pragma unroll
                for (int m = 0; m < SUMS; ++m) {
                    seven[m] = seven[m] * seventh;
                    six[m] = six[m] * sixth;
                }
                const Fit e(seven[0], seven[1], seven[2], seven[3], seven[4], seven[5], seven[6],
                            seven[7], (float)PRIOR);
                const Fit o(six[0], six[1], six[2], six[3], six[4], six[5], six[6], six[7],
                            (float)PRIOR);
                const int own = at(i + turn, l), other = at(i + 1 - turn, l);
                even[0][own] = e.w;
                even[1][own] = e.wa;
                even[2][own] = e.wb;
                odd[0][other] = o.w;
                odd[1][other] = o.wa;
                odd[2][other] = o.wb;
            }
        }
        __syncthreads();
        // The mean lines of both kinds, of which one gives the residuals. Deviations are not needed
        // any more.
        float found[TURNS][2];
#pragma unroll
        for (int t = 0; t < TURNS; ++t) {
            const int n = thread + t * THREADS;
            if (n >= (LONG + 2) / 2 * LINES) break;
            const int i = 19 + 2 * (n / LINES), l = n % LINES;
            float large[2][3], small[2][3], mixed[2][3], whole[2][3];
#pragma unroll
            for (int turn = 0; turn < 2; ++turn)
#pragma unroll
                for (int c = 0; c < 3; ++c) {
                    const float* e = even[c] + at(i - 6 + turn, l);
                    const float* o = odd[c] + at(i - 6 + turn, l);
                    const int later = turn ? 0 : LINES;
                    large[turn][c] = evens(e);
                    whole[turn][c] = evens(o);
                    // The other pixel's.
                    small[1 - turn][c] = odds(o + later);
                    mixed[1 - turn][c] = odds(e + later);
                }
#pragma unroll
            for (int turn = 0; turn < 2; ++turn) {
                float own[3], beside[3];
                for (int c = 0; c < 3; ++c) {
                    own[c] = large[turn][c] + small[turn][c];
                    beside[c] = whole[turn][c] + mixed[turn][c];
                }
                const float p = samples[at(i + turn, l)], q = mean(samples + at(i + turn - 1, l));
                rest[at(i + turn, l)] = p - settled((own[1] * q + own[2]) / own[0]);
                found[t][turn] = (beside[1] * p + beside[2]) / beside[0];
            }
        }
        __syncthreads();
#pragma unroll
        for (int t = 0; t < TURNS; ++t) {
            const int n = thread + t * THREADS;
            if (n >= (LONG + 2) / 2 * LINES) break;
            const int l = n % LINES;
#pragma unroll
            for (int turn = 0; turn < 2; ++turn) {
                const int i = 19 + 2 * (n / LINES) + turn;
                if (i < REACH || i >= SIZE - REACH) continue;
                const float p = samples[at(i, l)];
                const float value = settled(found[t][turn] + mean(rest + at(i - 1, l)));
                const bool green = (begin + i + first + l + red_row + red_column) & 1;
                guide[at(i, l)] = green ? p - value : value - p;
            }
        }
        __syncthreads();
        float* to = planes.data + (1 + vertical) * plane + (size_t)first * across +
                    (size_t)(begin + REACH) * along;
        for (int n = thread; n < (LONG + 7) / 8 * 8 * LINES; n += THREADS) {
            int i, l;
            pixel(n, i, l);
            if (i < LONG && begin + i < length && first + l < lines)
                to[(size_t)i * along + (size_t)l * across] = guide[at(i + REACH, l)];
        }
        __syncthreads();
    }
}

// The lines of windows beside green, with the sums of _chroma.h. A thread takes a cell of two by two
// pixels, whose windows have 4 x 4 samples, the one of the cell at (ROW, COLUMN).
// needs PRIOR, ROW, COLUMN
void cell_windows(int margin, wp::array_t<float> planes) {
    enum { SUMS = 8 };
    const int height = planes.shape[1], s = planes.shape[2], first = margin / 2 * 2;
    const size_t plane = (size_t)height * s;
    const int wide = (s - margin - first + 1) / 2, tall = (height - margin - first + 1) / 2;
    for (int item = blockIdx.x * blockDim.x + threadIdx.x; item < wide * tall;
         item += gridDim.x * blockDim.x) {
        const int y = first + 2 * (item / wide), x = first + 2 * (item % wide);
        const float* corner = planes.data + (size_t)(y - 2 - ROW) * s + (x - 2 - COLUMN);
        // Pixels on rows or columns of samples see three of them, those between see four: the
        // first index says which of the rows, the second which of the columns.
        float sums[2][2][SUMS];
#pragma unroll
        for (int c = 0; c < 4; ++c) {
            float rows[2][SUMS];
#pragma unroll
            for (int r = 0; r < 4; ++r) {
                const float* from = corner + (size_t)(2 * r) * s + 2 * c;
                const float p = from[0], g = from[3 * plane], u = from[4 * plane],
                            v = from[5 * plane];
                const float found[SUMS] = {p, g, u * v, v * v, u * u, p * p, p * g, g * g};
#pragma unroll
                for (int m = 0; m < SUMS; ++m) {
                    if (r >= ROW && r < ROW + 3)
                        rows[0][m] = (r > ROW ? rows[0][m] : 0.0f) + found[m];
                    rows[1][m] = (r ? rows[1][m] : 0.0f) + found[m];
                }
            }
#pragma unroll
            for (int k = 0; k < 2; ++k)
#pragma unroll
                for (int m = 0; m < SUMS; ++m) {
                    if (c >= COLUMN && c < COLUMN + 3)
                        sums[k][0][m] = c > COLUMN ? sums[k][0][m] + rows[k][m] : rows[k][m];
                    sums[k][1][m] = c ? sums[k][1][m] + rows[k][m] : rows[k][m];
                }
        }
        float* to = planes.data + 6 * plane;
#pragma unroll
        for (int k = 0; k < 2; ++k)
#pragma unroll
            for (int n = 0; n < 2; ++n) {
                const float share = 1.0f / (float)((3 + k) * (3 + n));
                float* a = sums[k][n];
                for (int m = 0; m < SUMS; ++m) a[m] = a[m] * share;
                const Fit fit(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], (float)PRIOR);
                const int row = y + (k ? 1 - ROW : ROW), column = x + (n ? 1 - COLUMN : COLUMN);
                if (row < margin || row >= height - margin) continue;
                if (column < margin || column >= s - margin) continue;
                float* at = to + (size_t)row * s + column;
                at[0] = fit.w;
                at[plane] = fit.wa;
                at[2 * plane] = fit.wb;
            }
    }
}

// The mean line of the windows about each pixel, and what it leaves, with the sums of _chroma.h. A
// warp goes down a strip of columns, of which the outer lanes only help.
// needs LONG
void mean_windows(int margin, wp::array_t<float> planes) {
    enum { ROWS = 7, WIDE = 32 - ROWS + 1, PLANES = 3 };
    const int height = planes.shape[1], s = planes.shape[2], lane = threadIdx.x % 32;
    const size_t plane = (size_t)height * s;
    const int strips = (s - 2 * margin + WIDE - 1) / WIDE;
    const int chunks = (height - 2 * margin + LONG - 1) / LONG;
    for (int item = (blockIdx.x * blockDim.x + threadIdx.x) / 32; item < strips * chunks;
         item += gridDim.x * blockDim.x / 32) {
        const int begin = margin + item / strips * LONG;
        const int end = begin + LONG < height - margin ? begin + LONG : height - margin;
        const int x = margin + item % strips * WIDE + lane - ROWS / 2;
        const bool own = lane >= ROWS / 2 && lane < ROWS / 2 + WIDE && x < s - margin;
        const float* at = planes.data + (size_t)(begin - ROWS / 2) * s + x;
        float ring[ROWS][PLANES];
        const auto read = [&](float* row) {
            for (int c = 0; c < PLANES; ++c) row[c] = at[(6 + c) * plane];
            at += s;
        };
#pragma unroll
        for (int k = 0; k < ROWS - 1; ++k) read(ring[k]);
        for (int top = begin; top < end; top += ROWS) {
#pragma unroll
            for (int k = 0; k < ROWS; ++k) {
                if (top + k >= end) break;
                read(ring[(k + ROWS - 1) % ROWS]);
                float line[PLANES];
#pragma unroll
                for (int c = 0; c < PLANES; ++c) {
                    float sum = ring[k][c];
#pragma unroll
                    for (int r = 1; r < ROWS; ++r) sum += ring[(k + r) % ROWS][c];
                    float total = __shfl_up_sync(0xffffffffu, sum, 3);
                    total += __shfl_up_sync(0xffffffffu, sum, 2);
                    total += __shfl_up_sync(0xffffffffu, sum, 1);
                    total += sum;
                    total += __shfl_down_sync(0xffffffffu, sum, 1);
                    total += __shfl_down_sync(0xffffffffu, sum, 2);
                    line[c] = total + __shfl_down_sync(0xffffffffu, sum, 3);
                }
                if (!own) continue;
                float* here = planes.data + (size_t)(top + k) * s + x;
                const float t = settled((line[1] * here[3 * plane] + line[2]) / line[0]);
                here[9 * plane] = t;
                here[4 * plane] = here[0] - t;
            }
        }
    }
}
