// FAST corners and binary descriptors on the CPU; taichi/features/binary.py has the rules. Corners
// are found a row at a time, 64 pixels at once, and described one at a time.

#include "../_angles.h"

// Mark FAST corners of rows: pixels whose score none of the eight around exceeds, of equal ones
// the first. The score is the largest threshold under which 9 neighbouring pixels of the circle are
// all brighter, or all darker; 0 where that is not above `threshold`. Scores of three rows stand in
// lines. The margin is at least 4 rows, and so large that reading up to 64 pixels beyond the end
// of the last row that has scores stays in the image.
void mark_rows(int slab, int first, int last, wp::array_t<wp::uint8> src, int threshold, int margin,
               wp::array_t<wp::uint8> lines, wp::array_t<int> words, wp::array_t<int> counts) {
    typedef unsigned char byte;
    enum { N = 64 };
    typedef byte lanes __attribute__((vector_size(N)));
    typedef bool flags __attribute__((ext_vector_type(N)));
    const int height = src.shape[0], width = src.shape[1], stored = words.shape[2];
    const int pitch = lines.shape[1], end = width - margin;
    byte* const base = lines.data + (size_t)slab * 3 * pitch + N;
    __builtin_memset(base - N, 0, 3 * (size_t)pitch);
    const long w = width;
    const long at[16] = {-3 * w,    -3 * w + 1, -2 * w + 2, -w + 3,    3,         w + 3,
                         2 * w + 2, 3 * w + 1,  3 * w,      3 * w - 1, 2 * w - 2, w - 3,
                         -3,        -w - 3,     -2 * w - 2, -3 * w - 1};
    const lanes least = (lanes){} + (byte)threshold;
    for (int row = first - 1; row <= last; ++row) {
        byte* const out = base + (row + 3) % 3 * pitch;
        if (row < margin || row >= height - margin) {
            __builtin_memset(out, 0, pitch - 2 * N);
        } else {
            for (int x = margin / N * N; x < end; x += N) {
                const byte* const c = src.data + (size_t)row * width + x;
                lanes v, p[16], result = {};
                __builtin_memcpy(&v, c, N);
#pragma unroll
                for (int k = 0; k < 16; k += 4) __builtin_memcpy(&p[k], c + at[k], N);
                const lanes above = __builtin_elementwise_add_sat(v, least);
                const lanes below = __builtin_elementwise_sub_sat(v, least);
                // 9 neighbours have one of each two that face each other.
                lanes high = __builtin_elementwise_max(p[0], p[8]);
                lanes low = __builtin_elementwise_min(p[0], p[8]);
                high = __builtin_elementwise_min(high, __builtin_elementwise_max(p[4], p[12]));
                low = __builtin_elementwise_max(low, __builtin_elementwise_min(p[4], p[12]));
                lanes may = (lanes)(high > above) | (lanes)(low < below);
                if (__builtin_reduce_or(may)) {
#pragma unroll
                    for (int k = 0; k < 16; ++k)
                        if (k % 4) __builtin_memcpy(&p[k], c + at[k], N);
                    // The least and the largest of 8 neighbours from each odd place on, and the
                    // better one of the two pixels beside them.
                    lanes bright = {}, dark = (lanes){} + (byte)255;
#pragma unroll
                    for (int k = 1; k < 16; k += 2) {
                        lanes a = p[k], b = p[k];
#pragma unroll
                        for (int n = 1; n < 8; ++n) {
                            a = __builtin_elementwise_min(a, p[(k + n) % 16]);
                            b = __builtin_elementwise_max(b, p[(k + n) % 16]);
                        }
                        const lanes one = p[k - 1], other = p[(k + 8) % 16];
                        a = __builtin_elementwise_min(a, __builtin_elementwise_max(one, other));
                        b = __builtin_elementwise_max(b, __builtin_elementwise_min(one, other));
                        bright = __builtin_elementwise_max(bright, a);
                        dark = __builtin_elementwise_min(dark, b);
                    }
                    result = __builtin_elementwise_max(__builtin_elementwise_sub_sat(bright, v),
                                                       __builtin_elementwise_sub_sat(v, dark));
                    result &= (lanes)(result > least);
                }
                __builtin_memcpy(out + x, &result, N);
            }
            __builtin_memset(out, 0, margin);
            __builtin_memset(out + end, 0, pitch - 2 * N - end);
        }
        const int y = row - 1;
        if (y < first) continue;
        const byte* const mid = base + (y + 3) % 3 * pitch;
        const byte* const top = base + (y + 2) % 3 * pitch;
        int* const to = words.data + (size_t)y * stored;
        int total = 0;
        for (int x = 0; x < width; x += N) {
            unsigned long long word = 0;
            lanes v;
            __builtin_memcpy(&v, mid + x, N);
            if (__builtin_reduce_or(v)) {
                lanes earlier = {}, later = {}, near;
#pragma unroll
                for (int j = -1; j <= 1; ++j) {
                    __builtin_memcpy(&near, top + x + j, N);
                    earlier = __builtin_elementwise_max(earlier, near);
                    __builtin_memcpy(&near, out + x + j, N);
                    later = __builtin_elementwise_max(later, near);
                }
                __builtin_memcpy(&near, mid + x - 1, N);
                earlier = __builtin_elementwise_max(earlier, near);
                __builtin_memcpy(&near, mid + x + 1, N);
                later = __builtin_elementwise_max(later, near);
                // No score of 0 exceeds what is around.
                const lanes found = (lanes)(v > earlier) & (lanes)(v >= later);
                const flags set = __builtin_convertvector(found, flags);
                __builtin_memcpy(&word, &set, sizeof word);
            }
            total += __builtin_popcountll(word);
            __builtin_memcpy(to + x / 32, &word, x / 32 + 1 < stored ? 8 : 4);
        }
        counts.data[y] = total;
    }
}

// List the marked pixels of a row, and Harris' measure over 7 x 7 pixels, times 25, of each. Rows
// of larger images are listed `before`.
void list_row(int row, wp::array_t<wp::uint8> src, wp::array_t<int> words, wp::array_t<int> ends,
              int image, int before, wp::array_t<int> cells, wp::array_t<wp::int64> responses) {
    typedef unsigned char bytes __attribute__((vector_size(8)));
    typedef short lanes __attribute__((vector_size(16)));
    typedef int wide __attribute__((vector_size(32)));
    const int width = src.shape[1], stored = words.shape[2];
    const lanes seven = {-1, -1, -1, -1, -1, -1, -1, 0};
    int at = before + row > 0 ? ends.data[before + row - 1] : 0;
    for (int k = 0; k < stored; ++k) {
        unsigned word = (unsigned)words.data[(size_t)row * stored + k];
        for (; word; word &= word - 1, ++at) {
            const int column = 32 * k + __builtin_ctz(word);
            const unsigned char* const c = src.data + (row - 4) * (size_t)width + column - 4;
            lanes sums[9], slopes[9];
#pragma unroll
            for (int i = 0; i < 9; ++i) {
                bytes parts[3];
                __builtin_memcpy(&parts[0], c + (size_t)i * width, 8);
                __builtin_memcpy(&parts[1], c + (size_t)i * width + 1, 8);
                __builtin_memcpy(&parts[2], c + (size_t)i * width + 2, 8);
                const lanes west = __builtin_convertvector(parts[0], lanes);
                const lanes middle = __builtin_convertvector(parts[1], lanes);
                const lanes east = __builtin_convertvector(parts[2], lanes);
                sums[i] = (west + 2 * middle + east) & seven;
                slopes[i] = (east - west) & seven;
            }
            wide yy = {}, xx = {}, xy = {};
#pragma unroll
            for (int i = 1; i < 8; ++i) {
                const wide gy = __builtin_convertvector(sums[i + 1] - sums[i - 1], wide);
                const wide gx =
                    __builtin_convertvector(slopes[i - 1] + 2 * slopes[i] + slopes[i + 1], wide);
                yy += gy * gy;
                xx += gx * gx;
                xy += gy * gx;
            }
            const long long a = __builtin_reduce_add(yy), b = __builtin_reduce_add(xx);
            const long long c2 = __builtin_reduce_add(xy);
            int* const cell = cells.data + 4 * (size_t)at;
            cell[0] = image, cell[1] = 1, cell[2] = row, cell[3] = column;
            responses.data[at] = 25 * (a * b - c2 * c2) - (a + b) * (a + b);
        }
    }
}

// needs DISC, BLUR, PAIRS, TURNS, TURNS_PER_RADIAN
// Direction of point `k` by the moments of a disc, and its bits: pairs of pixels compared, of the
// image smoothed down the rows and then along the columns.
void describe_one(int k, wp::array_t<wp::int64> images, wp::array_t<float> taps,
                  wp::array_t<int> cells, wp::array_t<int> pattern, int upright,
                  wp::array_t<float> angles, wp::array_t<wp::uint8> descriptors) {
#pragma clang fp contract(off)
    enum { SIDE = 2 * DISC + 1, READ = SIDE + 2 * BLUR, PITCH = 48, OUT = 32 };
    const int* const cell = cells.data + 4 * (size_t)k;
    const wp::int64* const image = images.data + 4 * (size_t)cell[0];
    const unsigned char* const src = (const unsigned char*)image[0];
    const size_t width = (size_t)image[3];
    const int cy = cell[2], cx = cell[3];
    float angle = 0.0f;
    int turn = 0;
    if (!upright) {
        int down = 0, along = 0;
        for (int i = -DISC; i <= DISC; ++i) {
            const unsigned char* p = src + (cy + i) * width + cx - DISC;
            const int room = DISC * (DISC + 1) - i * i;
            int sum = 0;
            for (int j = 0; j < SIDE; ++j) {
                const int v = (j - DISC) * (j - DISC) <= room ? p[j] : 0;
                sum += v;
                along += (j - DISC) * v;
            }
            down += i * sum;
        }
        angle = Alike::angle((float)down, (float)along);
        turn = (int)__builtin_floorf(angle * TURNS_PER_RADIAN + 0.5f) & (TURNS - 1);
    }
    angles.data[k] = angle;
    // A row has a few pixels more than are used.
    float values[READ][PITCH], smooth[SIDE][OUT];
    const unsigned char* from = src + (cy - DISC - BLUR) * width + cx - DISC - BLUR;
    for (int i = 0; i < READ; ++i)
        for (int j = 0; j < PITCH; ++j) values[i][j] = (float)from[i * width + j];
    const float* tap = taps.data;
    for (int i = 0; i < SIDE; ++i) {
        float line[PITCH];
        for (int j = 0; j < PITCH; ++j) {
            float sum = 0.0f;
#pragma unroll
            for (int t = 0; t <= 2 * BLUR; ++t) sum += tap[t] * values[i + t][j];
            line[j] = sum;
        }
        for (int j = 0; j < OUT; ++j) {
            float sum = 0.0f;
#pragma unroll
            for (int t = 0; t <= 2 * BLUR; ++t) sum += tap[t] * line[j + t];
            smooth[i][j] = sum;
        }
    }
    const float* const centre = &smooth[DISC][DISC];
    const int* pair = pattern.data + (size_t)turn * PAIRS * 4;
    for (int b = 0; b < PAIRS / 8; ++b) {
        int bits = 0;
#pragma unroll
        for (int n = 0; n < 8; ++n, pair += 4)
            bits |= (centre[pair[0] * OUT + pair[1]] < centre[pair[2] * OUT + pair[3]]) << n;
        descriptors.data[(size_t)k * (PAIRS / 8) + b] = (wp::uint8)bits;
    }
}

// Bytes of a row of values: rounded and cut off.
void round_row(int row, wp::array_t<float> src, wp::array_t<wp::uint8> dst) {
#pragma clang fp contract(off)
    const int width = dst.shape[1];
    const float* from = src.data + (size_t)row * width;
    wp::uint8* to = dst.data + (size_t)row * width;
    for (int x = 0; x < width; ++x) {
        const float v = from[x] > 0.0f ? from[x] : 0.0f;
        to[x] = (wp::uint8)(int)((v < 255.0f ? v : 255.0f) + 0.5f);
    }
}
