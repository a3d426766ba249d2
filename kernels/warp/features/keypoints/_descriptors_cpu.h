// Orientations and descriptors of keypoints on the CPU, 16 pixels of a window at once;
// taichi/features/keypoints/descriptors.py has the rules.

#include "../../_angles.h"

// needs BINS, PEAKS, LONGEST, BINS_PER_RADIAN, REACH
// Directions of the gradient round point `k`: the peaks of their histogram.
void orient_one(int k, wp::array_t<wp::int64> octaves, wp::array_t<int> windows,
                wp::array_t<float> spreads, float one, wp::array_t<float> angles,
                wp::array_t<int> counts) {
    const int* window = windows.data + 5 * (size_t)k;
    counts.data[k] = 0;
    if (window[0] < 0) return;
    const wp::int64* octave = octaves.data + 4 * (size_t)window[0];
    const int height = (int)octave[2], width = (int)octave[3];
    const int cy = window[2], cx = window[3], radius = window[4];
    const float* image = (const float*)octave[0] + (size_t)window[1] * height * width;
    const float spread = spreads.data[k];
    enum { N = 16, CHUNK = 64 };
    float gain[2 * REACH + 1 + N] = {0};
    for (int i = 0; i <= radius; ++i) {
        gain[radius + i] = Alike::decay((float)(i * i) * spread);
        gain[radius - i] = gain[radius + i];
    }
    // Neighbours, which often share a bin, are added to different sums: none waits for another.
    int parts[2][BINS] = {{0}};
    // Pixels of several rows: their gradients and weights.
    __attribute__((aligned(64))) float kept[3][CHUNK + N];
    float *const across = kept[0], *const downward = kept[1], *const weights = kept[2];
    const auto vote = [&]() __attribute__((noinline)) {
        int lengths[CHUNK], bins[CHUNK];
#pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < CHUNK; ++k) {
            const float dx = across[k], dy = downward[k];
            float length = __builtin_sqrtf(dx * dx + dy * dy);
            length = length < LONGEST ? length : LONGEST;
            float bin = Alike::angle(dy, dx) * BINS_PER_RADIAN + 0.5f;
            bin = bin < 0.0f ? bin + (float)BINS : bin;
            const int b = (int)bin;
            lengths[k] = (int)(length * weights[k] * one + 0.5f);
            bins[k] = b >= BINS ? b - BINS : b;
        }
#pragma clang loop unroll_count(16)
        for (int k = 0; k < CHUNK; ++k) parts[k % 2][bins[k]] += lengths[k];
    };
    const int left = cx - radius < 1 ? 1 : cx - radius;
    const int right = cx + radius > width - 2 ? width - 2 : cx + radius;
    int filled = 0;
    for (int y = cy - radius < 1 ? 1 : cy - radius; y <= cy + radius && y < height - 1; ++y) {
        const float* const p = image + (size_t)y * width;
        const float down = gain[y - cy + radius];
        const float* const along = gain + radius - cx;
        // Loads beyond the end of the row reach into the next row or level, which always exists.
        // What was collected beyond `right` is written over.
        for (int begin = left; begin <= right; begin += N) {
            __builtin_prefetch(p + begin + 4 * (size_t)width);
#pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < N; ++k) {
                const int x = begin + k;
                across[filled + k] = p[x + 1] - p[x - 1];
                downward[filled + k] = p[x + width] - p[x - width];
                weights[filled + k] = down * along[x];
            }
            filled += right - begin + 1 < N ? right - begin + 1 : N;
            if (filled < CHUNK) continue;
            vote();
            filled -= CHUNK;
            for (int i = 0; i < 3; ++i)
                __builtin_memcpy(kept[i], kept[i] + CHUNK, N * sizeof(float));
        }
    }
    for (; filled % CHUNK; ++filled) across[filled] = downward[filled] = weights[filled] = 0.0f;
    if (filled) vote();
    int sums[BINS];
    for (int b = 0; b < BINS; ++b) sums[b] = parts[0][b] + parts[1][b];
    long long smooth[BINS], most = 0;
    for (int b = 0; b < BINS; ++b) {
        const long long near = (long long)sums[(b + 1) % BINS] + sums[(b + BINS - 1) % BINS];
        const long long far = (long long)sums[(b + 2) % BINS] + sums[(b + BINS - 2) % BINS];
        smooth[b] = far + 4 * near + 6 * (long long)sums[b];
        most = smooth[b] > most ? smooth[b] : most;
    }
    int count = 0;
    unsigned long long taken = 0;
    while (count < PEAKS) {
        int best = -1;
        for (int b = 0; b < BINS; ++b) {
            const long long l = smooth[(b + BINS - 1) % BINS], r = smooth[(b + 1) % BINS];
            if (smooth[b] > l && smooth[b] > r && 5 * smooth[b] >= 4 * most && !(taken >> b & 1) &&
                (best < 0 || smooth[b] > smooth[best]))
                best = b;
        }
        if (best < 0) break;
        taken |= 1ull << best;
        const long long l = smooth[(best + BINS - 1) % BINS], r = smooth[(best + 1) % BINS];
        const double off = (double)(l - r) / (double)(l - 2 * smooth[best] + r);
        angles.data[(size_t)k * PEAKS + count++] = (float)((double)best + 0.5 * off);
    }
    counts.data[k] = count;
}

// needs CELLS, DIRECTIONS, LONGEST, DIRECTIONS_PER_RADIAN, REACH, LARGEST_SHARE, DESCRIPTOR_ONE
// Histograms of directions in the 4 x 4 cells round point `k`, as bytes.
void describe_one(int k, wp::array_t<wp::int64> octaves, wp::array_t<int> windows,
                  wp::array_t<float> turns, float one, int root,
                  wp::array_t<wp::uint8> descriptors) {
    const int* window = windows.data + 5 * (size_t)k;
    const wp::int64* octave = octaves.data + 4 * (size_t)window[0];
    const int height = (int)octave[2], width = (int)octave[3];
    const int cy = window[2], cx = window[3], radius = window[4];
    const float* image = (const float*)octave[0] + (size_t)window[1] * height * width;
    const float* turn = turns.data + 4 * (size_t)k;
    const float cosine = turn[0], sine = turn[1], angle = turn[2], spread = turn[3];
    enum { N = 16, CHUNK = 64, ROW = CELLS + 1, OUTSIDE = ROW * ROW * DIRECTIONS };
    float gain[2 * REACH + 1 + N] = {0};
    for (int i = 0; i <= radius; ++i) {
        gain[radius + i] = Alike::decay((float)(i * i) * spread);
        gain[radius - i] = gain[radius + i];
    }
    // The votes of a pixel for the four cells around it are adjacent. One sum holds the votes of
    // two neighbouring directions, the next one's in the upper half. All votes are positive, so no
    // lower half overflows. Neighbouring pixels often vote for the same place, so they are added to
    // different sums, and none waits for another.
    typedef unsigned long long both;
    typedef both quad __attribute__((vector_size(32)));
    typedef int lanes __attribute__((vector_size(4 * N)));
    quad sums[2][OUTSIDE + 1];
    __builtin_memset(sums, 0, sizeof sums);
    // Pixels of several rows: their gradients, weights, and places among the cells.
    __attribute__((aligned(64))) float kept[5][CHUNK + N];
    float *const across = kept[0], *const downward = kept[1], *const weights = kept[2];
    float *const rows = kept[3], *const columns = kept[4];
    const auto vote = [&]() __attribute__((noinline)) {
        __attribute__((aligned(64))) int places[CHUNK], parts[8][CHUNK];
        // Parameters of 64 bytes allow the registers of 64 bytes in this function.
        const auto low = [](lanes a, lanes b) __attribute__((always_inline)) {
            return __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7,
                                           23);
        };
        const auto high = [](lanes a, lanes b) __attribute__((always_inline)) {
            return __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14,
                                           30, 15, 31);
        };
#pragma clang loop vectorize(assume_safety) vectorize_width(16)
        for (int k = 0; k < CHUNK; ++k) {
            const float dx = across[k], dy = downward[k], r = rows[k], c = columns[k];
            float length = __builtin_sqrtf(dx * dx + dy * dy);
            length = length < LONGEST ? length : LONGEST;
            float bin = (Alike::angle(dy, dx) - angle) * DIRECTIONS_PER_RADIAN;
            bin = bin < 0.0f ? bin + (float)DIRECTIONS : bin;
            bin = bin >= (float)DIRECTIONS ? bin - (float)DIRECTIONS : bin;
            const float v = length * weights[k] * one;
            const bool inside = (r > -1.0f) & (r < (float)CELLS) & (c > -1.0f) & (c < (float)CELLS);
            const int r0 = inside ? (int)(r + 1.0f) : 0, c0 = inside ? (int)(c + 1.0f) : 0;
            const int o0 = (int)bin;
            const float fr = (r + 1.0f) - (float)r0, fc = (c + 1.0f) - (float)c0;
            const float fd = bin - (float)o0;
            const float v1 = v * fr, v0 = v - v1, v11 = v1 * fc, v01 = v0 * fc;
            const float v10 = v1 - v11, v00 = v0 - v01;
            const float w11 = v11 * fd, w10 = v10 * fd, w01 = v01 * fd, w00 = v00 * fd;
            places[k] = inside ? (r0 * ROW + c0) * DIRECTIONS + o0 : OUTSIDE;
            parts[0][k] = (int)((v00 - w00) + 0.5f);
            parts[1][k] = (int)(w00 + 0.5f);
            parts[2][k] = (int)((v01 - w01) + 0.5f);
            parts[3][k] = (int)(w01 + 0.5f);
            parts[4][k] = (int)((v10 - w10) + 0.5f);
            parts[5][k] = (int)(w10 + 0.5f);
            parts[6][k] = (int)((v11 - w11) + 0.5f);
            parts[7][k] = (int)(w11 + 0.5f);
        }
        for (int begin = 0; begin < CHUNK; begin += N) {
            // Interleaving rows i and i + 4 three times brings the 8 parts of a pixel together.
            lanes lines[8];
#pragma unroll
            for (int i = 0; i < 8; ++i)
                __builtin_memcpy(&lines[i], parts[i] + begin, sizeof(lanes));
#pragma unroll
            for (int times = 0; times < 3; ++times) {
                lanes turned[8];
#pragma unroll
                for (int i = 0; i < 4; ++i) {
                    turned[2 * i] = low(lines[i], lines[i + 4]);
                    turned[2 * i + 1] = high(lines[i], lines[i + 4]);
                }
#pragma unroll
                for (int i = 0; i < 8; ++i) lines[i] = turned[i];
            }
            quad given[N];
            __builtin_memcpy(given, lines, sizeof given);
#pragma unroll
            for (int k = 0; k < N; ++k) sums[k % 2][places[begin + k]] += given[k];
        }
    };
    typedef float pixels __attribute__((vector_size(4 * N)));
    const lanes numbers = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    const auto load = [](const float* from) {
        pixels v;
        __builtin_memcpy(&v, from, sizeof v);
        return v;
    };
    const auto store = [](float* to, pixels v)
                           __attribute__((always_inline)) { __builtin_memcpy(to, &v, sizeof v); };
    int count = 0;
    for (int y = cy - radius < 1 ? 1 : cy - radius; y <= cy + radius && y < height - 1; ++y) {
        const float i = (float)(y - cy), down = gain[y - cy + radius];
        const float row0 = i * cosine, column0 = i * sine;
        // Columns that can lie in the cells: |row0 - j sine| < 2.5 and |column0 + j cosine| < 2.5.
        float first = (float)-radius, last = (float)radius;
        if (__builtin_fabsf(sine) > 1e-4f) {
            const float a = (row0 - 2.5f) / sine, b = (row0 + 2.5f) / sine;
            first = __builtin_fmaxf(first, __builtin_fminf(a, b) - 1.0f);
            last = __builtin_fminf(last, __builtin_fmaxf(a, b) + 1.0f);
        }
        if (__builtin_fabsf(cosine) > 1e-4f) {
            const float a = (-2.5f - column0) / cosine, b = (2.5f - column0) / cosine;
            first = __builtin_fmaxf(first, __builtin_fminf(a, b) - 1.0f);
            last = __builtin_fminf(last, __builtin_fmaxf(a, b) + 1.0f);
        }
        if (first > last) continue;
        int left = cx + (int)first, right = cx + (int)last;
        left = left < 1 ? 1 : left;
        right = right > width - 2 ? width - 2 : right;
        const float* const p = image + (size_t)y * width;
        const float* const along = gain + radius - cx;
        // Loads beyond the end of the row reach into the next row or level, which always exists.
        // What was collected beyond `right` is written over.
        for (int begin = left; begin <= right; begin += N) {
            __builtin_prefetch(p + begin + 4 * (size_t)width);
            const pixels j = __builtin_convertvector(numbers + (begin - cx), pixels);
            const float* const q = p + begin;
            store(across + count, load(q + 1) - load(q - 1));
            store(downward + count, load(q + width) - load(q - width));
            store(weights + count, down * load(along + begin));
            store(rows + count, (row0 - j * sine) + 1.5f);
            store(columns + count, (column0 + j * cosine) + 1.5f);
            count += right - begin + 1 < N ? right - begin + 1 : N;
            if (count < CHUNK) continue;
            vote();
            count -= CHUNK;
#pragma unroll
            for (int i = 0; i < 5; ++i)
                __builtin_memcpy(kept[i], kept[i] + CHUNK, N * sizeof(float));
        }
    }
    for (; count % CHUNK; ++count) {
        across[count] = downward[count] = weights[count] = 0.0f;
        rows[count] = columns[count] = -2.0f;  // outside
    }
    if (count) vote();
    // A cell has been given something from the four places about it.
    both cells[CELLS * CELLS * DIRECTIONS];
    for (int n = 0; n < CELLS * CELLS * DIRECTIONS; ++n) {
        const int o = n % DIRECTIONS, c = n / DIRECTIONS % CELLS, r = n / DIRECTIONS / CELLS;
        const int at = (r * ROW + c) * DIRECTIONS + o;
        cells[n] = 0;
#pragma unroll
        for (int i = 0; i < 4; ++i) {
            const int from = at + (i / 2 * ROW + i % 2) * DIRECTIONS;
            cells[n] += sums[0][from][3 - i] + sums[1][from][3 - i];
        }
    }
    double found[CELLS * CELLS * DIRECTIONS], squares = 0.0;
    for (int n = 0; n < CELLS * CELLS * DIRECTIONS; ++n) {
        const int o = n % DIRECTIONS, c = n / DIRECTIONS % CELLS, r = n / DIRECTIONS / CELLS;
        const both* bin = cells + (r * CELLS + c) * DIRECTIONS;
        const int shared = (int)(bin[(o + DIRECTIONS - 1) % DIRECTIONS] >> 32);
        found[n] = (double)((int)(unsigned)bin[o] + shared);
        squares += found[n] * found[n];
    }
    const double most = LARGEST_SHARE * __builtin_sqrt(squares);
    double total = 0.0;
    for (int n = 0; n < CELLS * CELLS * DIRECTIONS; ++n) {
        found[n] = found[n] < most ? found[n] : most;
        total += root ? found[n] : found[n] * found[n];
    }
    const double size = root ? total : __builtin_sqrt(total);
    for (int n = 0; n < CELLS * CELLS * DIRECTIONS; ++n) {
        double share = size > 0.0 ? found[n] / size : 0.0;
        share = DESCRIPTOR_ONE * (root ? __builtin_sqrt(share) : share) + 0.5;
        descriptors.data[(size_t)k * CELLS * CELLS * DIRECTIONS + n] =
            (wp::uint8)(share < 255.0 ? share : 255.0);
    }
}
