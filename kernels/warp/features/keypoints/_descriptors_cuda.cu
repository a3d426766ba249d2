#include "../../_angles.h"

// needs BINS, PEAKS, LONGEST, BINS_PER_RADIAN, REACH
// Directions of the gradient round the point of a block: the peaks of their histogram.
void orient(wp::array_t<wp::int64> octaves, wp::array_t<int> windows, wp::array_t<float> spreads,
            float one, wp::array_t<float> angles, wp::array_t<int> counts) {
    __shared__ float gain[REACH + 1];
    __shared__ int sums[BINS];
    __shared__ wp::int64 smooth[BINS];
    const int k = blockIdx.x, thread = threadIdx.x, threads = blockDim.x;
    const int* window = windows.data + 5 * (size_t)k;
    if (window[0] < 0) {
        if (thread == 0) counts.data[k] = 0;
        return;
    }
    const wp::int64* octave = octaves.data + 4 * (size_t)window[0];
    const int height = (int)octave[2], width = (int)octave[3];
    const int cy = window[2], cx = window[3], radius = window[4];
    const float* image = (const float*)octave[0] + (size_t)window[1] * height * width;
    const float spread = spreads.data[k];
    for (int i = thread; i <= radius; i += threads) gain[i] = Alike::decay((float)(i * i) * spread);
    for (int b = thread; b < BINS; b += threads) sums[b] = 0;
    __syncthreads();
    const int top = max(cy - radius, 1), left = max(cx - radius, 1);
    const int wide = min(cx + radius, width - 2) - left + 1;
    const int pixels = wide * (min(cy + radius, height - 2) - top + 1);
    for (int n = thread; n < pixels; n += threads) {
        const int y = top + n / wide, x = left + n % wide;
        const float* const p = image + (size_t)y * width + x;
        const float dx = p[1] - p[-1], dy = p[width] - p[-width];
        float length = sqrtf(dx * dx + dy * dy);
        length = length < LONGEST ? length : LONGEST;
        float bin = Alike::angle(dy, dx) * BINS_PER_RADIAN + 0.5f;
        bin = bin < 0.0f ? bin + (float)BINS : bin;
        const int b = (int)bin;
        const float weight = gain[abs(y - cy)] * gain[abs(x - cx)];
        atomicAdd(&sums[b >= BINS ? b - BINS : b], (int)(length * weight * one + 0.5f));
    }
    __syncthreads();
    for (int b = thread; b < BINS; b += threads) {
        const wp::int64 near = (wp::int64)sums[(b + 1) % BINS] + sums[(b + BINS - 1) % BINS];
        const wp::int64 far = (wp::int64)sums[(b + 2) % BINS] + sums[(b + BINS - 2) % BINS];
        smooth[b] = far + 4 * near + 6 * (wp::int64)sums[b];
    }
    __syncthreads();
    if (thread >= 32) return;
    // A lane has two bins; a warp finds the largest peak that is left, of equal ones the first.
    wp::int64 most = 0;
    for (int b = thread; b < BINS; b += 32) most = smooth[b] > most ? smooth[b] : most;
    for (int apart = 16; apart; apart /= 2) {
        const wp::int64 other = __shfl_xor_sync(~0u, most, apart);
        most = other > most ? other : most;
    }
    wp::int64 height_of[2];  // -1 where there is no peak, or it was taken
    for (int i = 0; i < 2; ++i) {
        const int b = thread + 32 * i;
        height_of[i] = -1;
        if (b >= BINS) continue;
        const wp::int64 v = smooth[b], l = smooth[(b + BINS - 1) % BINS],
                        r = smooth[(b + 1) % BINS];
        if (v > l && v > r && 5 * v >= 4 * most) height_of[i] = v;
    }
    int count = 0;
    while (count < PEAKS) {
        const bool later = height_of[1] > height_of[0];
        wp::int64 high = later ? height_of[1] : height_of[0];
        int best = later ? thread + 32 : thread;
        for (int apart = 16; apart; apart /= 2) {
            const wp::int64 other = __shfl_xor_sync(~0u, high, apart);
            const int place = __shfl_xor_sync(~0u, best, apart);
            const bool taken = other > high || (other == high && place < best);
            high = taken ? other : high;
            best = taken ? place : best;
        }
        if (high < 0) break;
        if (best % 32 == thread) height_of[best / 32] = -1;
        if (thread == 0) {
            const wp::int64 l = smooth[(best + BINS - 1) % BINS], r = smooth[(best + 1) % BINS];
            const double off = (double)(l - r) / (double)(l - 2 * high + r);
            angles.data[(size_t)k * PEAKS + count] = (float)((double)best + 0.5 * off);
        }
        ++count;
    }
    if (thread == 0) counts.data[k] = count;
}

// needs CELLS, DIRECTIONS, LONGEST, DIRECTIONS_PER_RADIAN, REACH, LARGEST_SHARE, DESCRIPTOR_ONE
// Histograms of directions in the 4 x 4 cells round the point of a block, as bytes.
void describe(wp::array_t<wp::int64> octaves, wp::array_t<int> windows, wp::array_t<float> turns,
              float one, int root, wp::array_t<wp::uint8> descriptors) {
    // With a margin of cells, and the first direction again.
    enum { ROW = CELLS + 2, STEP = DIRECTIONS + 1, ROOM = ROW * ROW * STEP };
    enum { NUMBERS = CELLS * CELLS * DIRECTIONS };
    __shared__ float gain[REACH + 1];
    __shared__ int sums[ROOM];
    __shared__ double terms[NUMBERS];
    __shared__ double total;
    const int k = blockIdx.x, thread = threadIdx.x, threads = blockDim.x;
    const int* window = windows.data + 5 * (size_t)k;
    const wp::int64* octave = octaves.data + 4 * (size_t)window[0];
    const int height = (int)octave[2], width = (int)octave[3];
    const int cy = window[2], cx = window[3], radius = window[4];
    const float* image = (const float*)octave[0] + (size_t)window[1] * height * width;
    const float* turn = turns.data + 4 * (size_t)k;
    const float cosine = turn[0], sine = turn[1], angle = turn[2], spread = turn[3];
    for (int i = thread; i <= radius; i += threads) gain[i] = Alike::decay((float)(i * i) * spread);
    for (int n = thread; n < ROOM; n += threads) sums[n] = 0;
    __syncthreads();
    const int top = max(cy - radius, 1), left = max(cx - radius, 1);
    const int wide = min(cx + radius, width - 2) - left + 1;
    const int pixels = wide * (min(cy + radius, height - 2) - top + 1);
    for (int n = thread; n < pixels; n += threads) {
        const int y = top + n / wide, x = left + n % wide;
        const float i = (float)(y - cy), j = (float)(x - cx);
        const float r = (i * cosine - j * sine) + 1.5f, c = (i * sine + j * cosine) + 1.5f;
        if (!(r > -1.0f && r < (float)CELLS && c > -1.0f && c < (float)CELLS)) continue;
        const float* const p = image + (size_t)y * width + x;
        const float dx = p[1] - p[-1], dy = p[width] - p[-width];
        float length = sqrtf(dx * dx + dy * dy);
        length = length < LONGEST ? length : LONGEST;
        float bin = (Alike::angle(dy, dx) - angle) * DIRECTIONS_PER_RADIAN;
        bin = bin < 0.0f ? bin + (float)DIRECTIONS : bin;
        bin = bin >= (float)DIRECTIONS ? bin - (float)DIRECTIONS : bin;
        const float v = length * (gain[abs(y - cy)] * gain[abs(x - cx)]) * one;
        const int r0 = (int)(r + 1.0f), c0 = (int)(c + 1.0f), o0 = (int)bin;
        const float fr = (r + 1.0f) - (float)r0, fc = (c + 1.0f) - (float)c0;
        const float fd = bin - (float)o0;
        const float v1 = v * fr, v0 = v - v1, v11 = v1 * fc, v01 = v0 * fc;
        const float parts[4] = {v0 - v01, v01, v1 - v11, v11};
        int* const to = sums + (r0 * ROW + c0) * STEP + o0;
#pragma unroll
        for (int q = 0; q < 4; ++q) {
            const float w = parts[q] * fd;
            atomicAdd(to + (q / 2 * ROW + q % 2) * STEP, (int)((parts[q] - w) + 0.5f));
            atomicAdd(to + (q / 2 * ROW + q % 2) * STEP + 1, (int)(w + 0.5f));
        }
    }
    __syncthreads();
    // A thread has a number. Sums of floats are in the order of the numbers: by one thread.
    const int o = thread % DIRECTIONS, c = thread / DIRECTIONS % CELLS;
    const int* const bins = sums + ((thread / DIRECTIONS / CELLS + 1) * ROW + c + 1) * STEP;
    double found = (double)(bins[o] + (o == 0 ? bins[DIRECTIONS] : 0));
    terms[thread] = found * found;
    __syncthreads();
    if (thread == 0) {
        double sum = 0.0;
#pragma unroll 16
        for (int n = 0; n < NUMBERS; ++n) sum += terms[n];
        total = LARGEST_SHARE * sqrt(sum);
    }
    __syncthreads();
    found = found < total ? found : total;
    terms[thread] = root ? found : found * found;
    __syncthreads();
    if (thread == 0) {
        double sum = 0.0;
#pragma unroll 16
        for (int n = 0; n < NUMBERS; ++n) sum += terms[n];
        total = root ? sum : sqrt(sum);
    }
    __syncthreads();
    double share = total > 0.0 ? found / total : 0.0;
    share = DESCRIPTOR_ONE * (root ? sqrt(share) : share) + 0.5;
    descriptors.data[(size_t)k * NUMBERS + thread] = (wp::uint8)(share < 255.0 ? share : 255.0);
}
