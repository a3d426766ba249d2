#include "_moves_cuda.h"

// needs LEVELS, ROWS
// Find extrema among 26 neighbours, and queue their octave, level, row and column for `move`; for
// those that find no room do its work. A warp takes 32 columns of ROWS rows of an octave, and keeps
// the maxima and minima of three columns, of this row and of those before.
void mark(wp::array_t<wp::int64> octaves, float threshold, float contrast, float edge, int margin,
          wp::array_t<int> queue, wp::array_t<int> number, wp::array_t<int> words,
          wp::array_t<int> counts) {
    enum { D = LEVELS + 2 };
    const int lane = threadIdx.x % 32;
    int item = (int)((blockIdx.x * (size_t)blockDim.x + threadIdx.x) / 32), o = 0;
    const wp::int64* octave = octaves.data;
    for (;; octave += 4, ++o) {
        if (o == octaves.shape[0]) return;  // the whole warp
        const int stored = ((int)octave[3] + 31) / 32;
        const int items = ((int)octave[2] + ROWS - 1) / ROWS * stored;
        if (item < items) break;
        item -= items;
    }
    const float* const base = (const float*)octave[0];
    const int height = (int)octave[2], width = (int)octave[3], stored = (width + 31) / 32;
    const size_t plane = (size_t)height * width;
    const int top = item / stored * ROWS, bottom = min(top + ROWS, height);
    const int left = item % stored * 32, x = left + lane, at = min(x, width - 1);
    // The first and the last lane load their neighbours outside.
    const bool outer = lane == 0 || lane == 31;
    const int beside = lane == 0 ? max(left - 1, 0) : min(left + 32, width - 1);
    const bool inside = x >= margin && x < width - margin;
    float high[2][D], low[2][D], middle[LEVELS];  // extrema in the two rows before
    for (int y = top - 1; y <= bottom; ++y) {
        const size_t begin = (size_t)min(max(y, 0), height - 1) * width;
        float value[D], most[D], least[D];
        float before = __ldg(base + begin + at), other = 0.0f;
        if (outer) other = __ldg(base + begin + beside);
#pragma unroll
        for (int l = 0; l < D; ++l) {
            const float* const p = base + (l + 1) * plane + begin;
            const float next = __ldg(p + at), next_other = outer ? __ldg(p + beside) : 0.0f;
            value[l] = next - before;
            const float far = next_other - other;
            before = next, other = next_other;
            float a = __shfl_up_sync(~0u, value[l], 1), b = __shfl_down_sync(~0u, value[l], 1);
            a = lane == 0 ? far : a, b = lane == 31 ? far : b;
            most[l] = fmaxf(fmaxf(a, b), value[l]), least[l] = fminf(fminf(a, b), value[l]);
        }
        const int r = y - 1;
        if (y > top && r >= margin && r < height - margin) {
            float up[D], down[D];
#pragma unroll
            for (int l = 0; l < D; ++l) {
                up[l] = fmaxf(fmaxf(high[0][l], high[1][l]), most[l]);
                down[l] = fminf(fminf(low[0][l], low[1][l]), least[l]);
            }
#pragma unroll
            for (int s = 1; s <= LEVELS; ++s) {
                const float v = middle[s - 1];
                const bool found =
                    inside &&
                    ((v > threshold && v >= fmaxf(fmaxf(up[s - 1], up[s]), up[s + 1])) ||
                     (v < -threshold && v <= fminf(fminf(down[s - 1], down[s]), down[s + 1])));
                const unsigned all = __ballot_sync(~0u, found);
                if (all == 0) continue;
                int place = 0;
                if (lane == 0) place = atomicAdd(number.data, __popc(all));
                place = __shfl_sync(~0u, place, 0) + __popc(all & ((1u << lane) - 1));
                if (!found) continue;
                const int4 cell = make_int4(o, s, r, x);
                if (place < queue.shape[0])
                    ((int4*)queue.data)[place] = cell;
                else
                    Moves::keep(octaves.data, cell, contrast, edge, margin, words.data,
                                counts.data);
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

// Move the queued extrema to where their fits end. Of a grid of any size, a thread takes several.
void move(wp::array_t<wp::int64> octaves, float contrast, float edge, int margin,
          wp::array_t<int> queue, wp::array_t<int> number, wp::array_t<int> words,
          wp::array_t<int> counts) {
    const int last = min(number.data[0], queue.shape[0]);
    for (int n = blockIdx.x * blockDim.x + threadIdx.x; n < last; n += gridDim.x * blockDim.x)
        Moves::keep(octaves.data, ((const int4*)queue.data)[n], contrast, edge, margin, words.data,
                    counts.data);
}
