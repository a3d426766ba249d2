#include "_moves_cuda.h"

// needs COLUMNS, LEVELS, ROWS
// Count extrema among 26 neighbours, and queue octave, level, row and column of those that find
// room. A warp takes ROWS rows of COLUMNS columns inside the margin of an
// octave, and its outer lanes the columns beside them. It loads each row while it compares the one
// before, and keeps the maxima and minima of three columns, of this row and of those before.
void mark(wp::array_t<wp::int64> octaves, float threshold, int margin, wp::array_t<int> queue,
          wp::array_t<int> number) {
    enum { D = LEVELS + 2 };
    const int lane = threadIdx.x % 32;
    int item = (int)((blockIdx.x * (size_t)blockDim.x + threadIdx.x) / 32), o = 0, across;
    const wp::int64* octave = octaves.data;
    for (;; octave += 4, ++o) {
        if (o == octaves.shape[0]) return;  // the whole warp
        const int tall = max((int)octave[2] - 2 * margin, 0);
        across = (max((int)octave[3] - 2 * margin, 0) + COLUMNS - 1) / COLUMNS;
        const int items = (tall + ROWS - 1) / ROWS * across;
        if (item < items) break;
        item -= items;
    }
    const int height = (int)octave[2], width = (int)octave[3];
    const size_t plane = (size_t)height * width;
    const int top = margin + item / across * ROWS, bottom = min(top + ROWS, height - margin);
    const int x = margin + item % across * COLUMNS + lane - 1;
    const bool inside = lane > 0 && lane <= COLUMNS && x < width - margin;
    // The margin is at least one pixel, so that only columns behind the last one are cut off.
    const float* from = (const float*)octave[0] + (size_t)(top - 1) * width + min(x, width - 1);
    float ahead[D + 1];
#pragma unroll
    for (int l = 0; l <= D; ++l) ahead[l] = __ldg(from + l * plane);
    float high[2][D], low[2][D], middle[LEVELS];  // extrema in the two rows before
#pragma unroll 2
    for (int y = top - 1; y <= bottom; ++y) {
        float value[D], most[D], least[D];
#pragma unroll
        for (int l = 0; l < D; ++l) value[l] = ahead[l + 1] - ahead[l];
        if (y < bottom) from += width;
#pragma unroll
        for (int l = 0; l <= D; ++l) ahead[l] = __ldg(from + l * plane);
#pragma unroll
        for (int l = 0; l < D; ++l) {
            const float a = __shfl_up_sync(~0u, value[l], 1);
            const float b = __shfl_down_sync(~0u, value[l], 1);
            most[l] = fmaxf(fmaxf(a, b), value[l]), least[l] = fminf(fminf(a, b), value[l]);
        }
        bool large = false;
#pragma unroll
        for (int s = 0; s < LEVELS; ++s) large = large || fabsf(middle[s]) > threshold;
        if (y > top && __any_sync(~0u, inside && large)) {
            float up[D], down[D];
#pragma unroll
            for (int l = 0; l < D; ++l) {
                up[l] = fmaxf(fmaxf(high[0][l], high[1][l]), most[l]);
                down[l] = fminf(fminf(low[0][l], low[1][l]), least[l]);
            }
            unsigned all[LEVELS];
            int found = 0;
#pragma unroll
            for (int s = 1; s <= LEVELS; ++s) {
                const float v = middle[s - 1];
                const bool extreme =
                    inside &&
                    ((v > threshold && v >= fmaxf(fmaxf(up[s - 1], up[s]), up[s + 1])) ||
                     (v < -threshold && v <= fminf(fminf(down[s - 1], down[s]), down[s + 1])));
                all[s - 1] = __ballot_sync(~0u, extreme);
                found += __popc(all[s - 1]);
            }
            if (found) {
                int place = 0;
                if (lane == 0) place = atomicAdd(number.data, found);
                place = __shfl_sync(~0u, place, 0);
#pragma unroll
                for (int s = 1; s <= LEVELS; ++s) {
                    const unsigned here = all[s - 1];
                    const int at = place + __popc(here & ((1u << lane) - 1));
                    place += __popc(here);
                    if (!(here >> lane & 1)) continue;
                    if (at < queue.shape[0]) ((int4*)queue.data)[at] = make_int4(o, s, y - 1, x);
                }
            }
        }
#pragma unroll
        for (int l = 0; l < D; ++l) {
            high[0][l] = high[1][l], high[1][l] = most[l];
            low[0][l] = low[1][l], low[1][l] = least[l];
        }
#pragma unroll
        for (int s = 0; s < LEVELS; ++s) middle[s] = value[s + 1];
    }
}

// Move extrema to where their fits end: the queued ones, or all if some found no room. Of a grid of
// any size, a thread takes several.
void move(wp::array_t<wp::int64> octaves, float threshold, float contrast, float edge, int margin,
          wp::array_t<int> queue, wp::array_t<int> number, wp::array_t<int> words,
          wp::array_t<int> counts) {
    const size_t thread = blockIdx.x * (size_t)blockDim.x + threadIdx.x;
    const size_t threads = gridDim.x * (size_t)blockDim.x;
    const int last = number.data[0];
    if (last <= queue.shape[0]) {
        for (size_t n = thread; n < last; n += threads)
            Moves::keep(octaves.data, ((const int4*)queue.data)[n], contrast, edge, margin,
                        words.data, counts.data);
        return;
    }
    for (int o = 0; o < octaves.shape[0]; ++o) {
        const wp::int64* const octave = octaves.data + 4 * (size_t)o;
        const size_t height = octave[2], width = octave[3], plane = height * width;
        for (size_t n = thread; n < octave[1] * plane; n += threads) {
            const int s = (int)(n / plane) + 1, y = (int)(n / width % height), x = (int)(n % width);
            if (y < margin || y >= height - margin || x < margin || x >= width - margin) continue;
            const float* const from = (const float*)octave[0] + n + plane;
            const float v = from[plane] - from[0];
            bool most = v > threshold, least = v < -threshold;
            for (int k = 0; k < 27 && (most || least); ++k) {
                const float* const p = from + (k / 9 - 1) * (long long)plane +
                                       (k / 3 % 3 - 1) * (long long)width + (k % 3 - 1);
                const float other = p[plane] - p[0];
                most = most && v >= other, least = least && v <= other;
            }
            if (most || least)
                Moves::keep(octaves.data, make_int4(o, s, y, x), contrast, edge, margin, words.data,
                            counts.data);
        }
    }
}
