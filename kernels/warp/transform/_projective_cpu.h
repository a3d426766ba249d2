// Linear samples at given places, or through a homography, on the CPU, 16 pixels of a row at once;
// sampling.py and projective.py have the equations.

// needs MAPPED, NEAREST, ROUNDED, CHANNELS, PART, PLACE_BITS, MIDDLE, START, START_HIGH
// Rows from `top` on of a tile, PART pixels wide from `start` on, linearly or the NEAREST. `places`
// is a homography, which takes (x, y, 1) of the result to the image; if MAPPED, the rows and the
// columns of all places. A tile needs little of the image, which stays in the cache. Returns how
// many pixels it lists in `left`, for others to find: those on the last rows or the last column,
// and, unless all beyond the image is `cval`, those beyond. So nothing is read behind the image,
// though more than two pixels are read at once. Bytes of the result from bytes are in whole steps:
// see _bytes.py.
int warp_tile(int top, int bottom, int start, int slab, wp::array_t<float> src,
              wp::array_t<double> places, int constant, float cval, wp::array_t<int> left,
              wp::array_t<float> dst) {
#pragma clang fp contract(off)
    enum { N = 16, C = CHANNELS, INSIDE = 1, LEFT = 2, AWAY = 4 };
    typedef __typeof__(*src.data) source;
    typedef __typeof__(*dst.data) result;
    typedef __typeof__(*places.data) real;
    enum { STEPS = ROUNDED && sizeof(source) == 1 && !MAPPED && !NEAREST };
    typedef source taken __attribute__((vector_size(2 * N * sizeof(source))));
    typedef source taken4 __attribute__((vector_size(4 * sizeof(source))));
    typedef result given __attribute__((vector_size(N * sizeof(result))));
    typedef result given4 __attribute__((vector_size(4 * sizeof(result))));
    typedef float lanes __attribute__((vector_size(N * sizeof(float))));
    typedef float lanes4 __attribute__((vector_size(4 * sizeof(float))));
    typedef int whole __attribute__((vector_size(N * sizeof(int))));
    typedef int whole4 __attribute__((vector_size(4 * sizeof(int))));
    typedef unsigned long long pixels __attribute__((vector_size(32)));
    typedef unsigned halves __attribute__((vector_size(16)));
    typedef unsigned char bytes __attribute__((vector_size(16)));
    const auto clipped = [](auto v) {
        v = v > 0.0f ? v : 0.0f;
        return (v < 255.0f ? v : 255.0f) + 0.5f;
    };
    const int planes = dst.shape[0], tall = dst.shape[1], wide = dst.shape[2];
    const int height = src.shape[1], width = src.shape[2], pitch = width * C;
    const auto* const m = places.data;
    const real last_x = width - 1, last_y = height - 1;
    const bool affine = !MAPPED && m[6] == 0.0 && m[7] == 0.0 && m[8] == 1.0;
    const result outside = (result)(ROUNDED ? (float)(int)clipped((lanes4){} + cval)[0] : cval);
    int* const list = left.data + (size_t)slab * left.shape[1];
    int listed = 0;
    const int size = wide - start < PART ? wide - start : PART;
    for (int row = top; row < bottom; ++row) {
        // First all places, then all samples: their divisions and loads do not wait for another.
        const double v = row;
        real xs[PART], ys[PART];
        int at[PART], state[PART], there[PART / N], other[PART / N];
        float fx[PART], fy[PART];
        int share[4][PART];  // The shares of the four pixels of a place, in steps.
        const auto* const here = m + (size_t)row * wide + start;
        for (int k = 0; MAPPED && k < size; ++k) {
            ys[k] = here[k];
            xs[k] = here[k + (size_t)tall * wide];
        }
        for (int k = size; MAPPED && k < PART; ++k) xs[k] = ys[k] = 0;
        for (int k = 0; k < PART && !MAPPED; ++k) {
            const double u = start + k;
            xs[k] = STEPS ? m[0] * u + (m[1] * v + m[2]) : m[0] * u + m[1] * v + m[2];
            ys[k] = STEPS ? m[3] * u + (m[4] * v + m[5]) : m[3] * u + m[4] * v + m[5];
        }
        for (int k = 0; STEPS && k < PART; ++k) {
            const double r = 1.0 / (m[6] * (double)(start + k) + (m[7] * v + m[8]));
            xs[k] = xs[k] * r + START;
            ys[k] = ys[k] * r + START;
        }
        for (int k = 0; k < PART && !affine && !STEPS && !MAPPED;
             ++k) {  // to divide by 1 changes nothing
            const double w = m[6] * (double)(start + k) + m[7] * v + m[8];
            xs[k] /= w;
            ys[k] /= w;
        }
        for (int b = 0; b < PART / N; ++b) {
            there[b] = other[b] = 0;
#pragma clang loop vectorize(assume_safety)
            for (int k = N * b; k < N * (b + 1); ++k) {
                bool good;
                int i, j;
                if (STEPS) {
                    unsigned long long x, y;
                    __builtin_memcpy(&x, xs + k, sizeof x);
                    __builtin_memcpy(&y, ys + k, sizeof y);
                    i = (int)((unsigned)(y >> 32) - START_HIGH),
                    j = (int)((unsigned)(x >> 32) - START_HIGH);
                    good = ((unsigned)j < (unsigned)(width - 1)) & (i >= 0) & (i < height - 2);
                    const int across = (unsigned)x >> (32 - PLACE_BITS);
                    const int down = (unsigned)y >> (32 - PLACE_BITS);
                    const int both = (int)((unsigned long long)across * down >> PLACE_BITS);
                    share[0][k] = (1 << PLACE_BITS) - across - down + both;
                    share[1][k] = across - both;
                    share[2][k] = down - both;
                    share[3][k] = both;
                    i = good ? i : 0, j = good ? j : 0;
                } else {
                    const real x = xs[k], y = ys[k];
                    good = NEAREST ? (x >= 0) & (x <= last_x) & (y >= 0) & (y <= last_y)
                                   : (x >= 0) & (x < last_x) & (y >= 0) & (y < last_y - 1);
                    // A half is added in float64: in float32 the sum may be rounded up.
                    i = good ? (int)(NEAREST ? (double)y + 0.5 : (double)y) : 0;
                    j = good ? (int)(NEAREST ? (double)x + 0.5 : (double)x) : 0;
                    fx[k] = (float)(x - (real)j);
                    fy[k] = (float)(y - (real)i);
                }
                at[k] = i * pitch + j * C;
                state[k] = good ? INSIDE : LEFT;
                there[b] |= state[k] & INSIDE;
                other[b] |= state[k] & LEFT;
            }
            for (int k = N * b; other[b] && k < N * (b + 1); ++k) {
                const double x = xs[k] - (STEPS ? MIDDLE : 0.0), y = ys[k] - (STEPS ? MIDDLE : 0.0);
                const double step = 1.0 / (1 << PLACE_BITS);
                const bool ends = STEPS ? (x < last_x + step) & (y < last_y + step)
                                        : (x <= last_x) & (y <= last_y);
                const bool within = (x >= 0.0) & (y >= 0.0) & ends;
                if (constant && !within) state[k] = AWAY;
                if (state[k] == LEFT && k < size) list[listed++] = (row - top) * PART + k;
            }
        }
        for (int p = 0; p < planes; ++p) {
            const source* const from = src.data + (size_t)p * height * pitch;
            result* const to = dst.data + (((size_t)p * tall + row) * wide + start) * C;
            result found[PART * C + 4];
            for (int b = 0; b < PART / N && N * b < size; ++b) {
                if (!there[b]) continue;
                if (NEAREST) {
                    for (int k = N * b; k < N * (b + 1); ++k)
                        for (int c = 0; c < C; ++c) {
                            const source v = from[at[k] + c];
                            found[k * C + c] = sizeof(source) == sizeof(result) || !ROUNDED
                                                   ? (result)v
                                                   : (result)(int)clipped((lanes4){} + (float)v)[0];
                        }
                    continue;
                }
                if (C == 1) {
                    source pairs[2][2 * N];
#pragma unroll
                    for (int k = 0; k < N; ++k) {
                        const source* const q = from + at[N * b + k];
                        __builtin_memcpy(&pairs[0][2 * k], q, 2 * sizeof(source));
                        __builtin_memcpy(&pairs[1][2 * k], q + pitch, 2 * sizeof(source));
                    }
                    lanes x, y, lines[2];
                    whole steps = (whole){} + (1 << (PLACE_BITS - 1));
                    __builtin_memcpy(&x, fx + N * b, sizeof x);
                    __builtin_memcpy(&y, fy + N * b, sizeof y);
#pragma unroll
                    for (int i = 0; i < 2; ++i) {
                        taken both;
                        __builtin_memcpy(&both, pairs[i], sizeof both);
                        const auto west = __builtin_shufflevector(
                            both, both, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
                        const auto east = __builtin_shufflevector(
                            both, both, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
                        if (STEPS) {
                            whole shares[2];
                            __builtin_memcpy(&shares[0], share[2 * i] + N * b, sizeof shares[0]);
                            __builtin_memcpy(&shares[1], share[2 * i + 1] + N * b,
                                             sizeof shares[1]);
                            steps += shares[0] * __builtin_convertvector(west, whole) +
                                     shares[1] * __builtin_convertvector(east, whole);
                        } else {
                            lines[i] = (1.0f - x) * __builtin_convertvector(west, lanes) +
                                       x * __builtin_convertvector(east, lanes);
                        }
                    }
                    given made;
                    if (STEPS) {
                        made = __builtin_convertvector(steps >> PLACE_BITS, given);
                    } else {
                        const lanes sum = (1.0f - y) * lines[0] + y * lines[1];
                        if (ROUNDED)
                            made = __builtin_convertvector(
                                __builtin_convertvector(clipped(sum), whole), given);
                        else
                            made = __builtin_convertvector(sum, given);
                    }
                    __builtin_memcpy(found + N * b, &made, sizeof made);
                    continue;
                }
                if (sizeof(source) == 1 && (C == 3 || C == 4)) {
                    // Four pixels at once. Eight bytes have both pixels of a row.
#pragma unroll
                    for (int k = N * b; k < N * (b + 1); k += 4) {
                        lanes lines[2] = {};
                        lanes4 across, down;
                        whole steps = (whole){} + (1 << (PLACE_BITS - 1));
                        __builtin_memcpy(&across, fx + k, sizeof across);
                        __builtin_memcpy(&down, fy + k, sizeof down);
                        const auto each = [](auto four) {
                            return __builtin_shufflevector(four, four, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2,
                                                           2, 2, 3, 3, 3, 3);
                        };
                        const lanes x = each(across), y = each(down);
#pragma unroll
                        for (int i = 0; i < 2; ++i) {
                            unsigned long long parts[4];
#pragma unroll
                            for (int n = 0; n < 4; ++n)
                                __builtin_memcpy(&parts[n], from + at[k + n] + i * pitch, 8);
                            const pixels both = {parts[0], parts[1], parts[2], parts[3]};
                            const bytes west = (bytes) __builtin_convertvector(both, halves);
                            const bytes east =
                                (bytes) __builtin_convertvector(both >> (8 * C), halves);
                            if (STEPS) {
                                whole4 shares[2];
                                __builtin_memcpy(&shares[0], share[2 * i] + k, sizeof shares[0]);
                                __builtin_memcpy(&shares[1], share[2 * i + 1] + k,
                                                 sizeof shares[1]);
                                steps += each(shares[0]) * __builtin_convertvector(west, whole) +
                                         each(shares[1]) * __builtin_convertvector(east, whole);
                            } else {
                                lines[i] = (1.0f - x) * __builtin_convertvector(west, lanes) +
                                           x * __builtin_convertvector(east, lanes);
                            }
                        }
                        given made;
                        const lanes sum = (1.0f - y) * lines[0] + y * lines[1];
                        if (STEPS)
                            made = __builtin_convertvector(steps >> PLACE_BITS, given);
                        else if (ROUNDED)
                            made = __builtin_convertvector(
                                __builtin_convertvector(clipped(sum), whole), given);
                        else
                            made = __builtin_convertvector(sum, given);
                        if (C == 3)
                            made = __builtin_shufflevector(made, made, 0, 1, 2, 4, 5, 6, 8, 9, 10,
                                                           12, 13, 14, 14, 14, 14, 14);
                        __builtin_memcpy(found + k * C, &made, sizeof made);
                    }
                    continue;
                }
#pragma clang loop unroll_count(4)
                for (int k = N * b; k < N * (b + 1); ++k) {
                    const source* const q = from + at[k];
                    const float x = fx[k], y = fy[k];
                    taken4 corners[4];
                    __builtin_memcpy(&corners[0], q, sizeof corners[0]);
                    __builtin_memcpy(&corners[1], q + C, sizeof corners[0]);
                    __builtin_memcpy(&corners[2], q + pitch, sizeof corners[0]);
                    __builtin_memcpy(&corners[3], q + pitch + C, sizeof corners[0]);
                    const lanes4 top = (1.0f - x) * __builtin_convertvector(corners[0], lanes4) +
                                       x * __builtin_convertvector(corners[1], lanes4);
                    const lanes4 low = (1.0f - x) * __builtin_convertvector(corners[2], lanes4) +
                                       x * __builtin_convertvector(corners[3], lanes4);
                    const lanes4 sum = (1.0f - y) * top + y * low;
                    given4 made;
                    if (ROUNDED)
                        made = __builtin_convertvector(
                            __builtin_convertvector(clipped(sum), whole4), given4);
                    else
                        made = __builtin_convertvector(sum, given4);
                    __builtin_memcpy(found + k * C, &made, sizeof made);
                }
            }
            for (int b = 0; b < PART / N && N * b < size; ++b)
                if (other[b])
                    for (int k = N * b; k < N * (b + 1); ++k)
                        if (state[k] == AWAY)
                            for (int c = 0; c < C; ++c) found[k * C + c] = outside;
            if (size == PART)
                __builtin_memcpy(to, found, PART * C * sizeof(result));
            else
                for (int i = 0; i < size * C; ++i) to[i] = found[i];
        }
    }
    return listed;
}
