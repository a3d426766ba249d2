// FAST corners and binary descriptors on the CPU; taichi/features/binary.py has the rules. Corners
// are found a row at a time, 64 pixels at once, and described one at a time. The table of images has
// address, 1, height and width of each; rows of all images are numbered one after the other.

#include "../_angles.h"

// Mark FAST corners of rows: pixels whose score none of the eight around exceeds, of equal ones
// the first. The score is the largest threshold under which 9 neighbouring pixels of the circle are
// all brighter, or all darker; 0 where that is not above `threshold`. A corner sets its bit in
// `words`, 32 pixels a word, and `counts` has the corners of each row. Scores of three rows are in
// `lines`. The margin is at least 4 rows, and so large that reading up to 64 pixels beyond the end
// of the last row that has scores stays in the image.
void mark_rows(int slab, int start, int stop, wp::array_t<wp::int64> images, int threshold,
               int margin, wp::array_t<wp::uint8> lines, wp::array_t<int> words,
               wp::array_t<int> counts) {
    typedef unsigned char byte;
    enum { N = 64 };
    typedef byte lanes __attribute__((vector_size(N)));
    typedef bool flags __attribute__((ext_vector_type(N)));
    const int pitch = lines.shape[1];
    byte* const base = lines.data + (size_t)slab * 3 * pitch + N;
    const lanes least = (lanes){} + (byte)threshold;
    // Parameters of 64 bytes allow the registers of 64 bytes in this function.
    const auto either = [](lanes a, lanes b) __attribute__((always_inline)) { return a | b; };
    int* marks = words.data;
    for (int image = 0, before = 0; image < images.shape[0] && before < stop; ++image) {
        const wp::int64* const entry = images.data + 4 * image;
        const byte* const src = (const byte*)entry[0];
        const int height = (int)entry[2], width = (int)entry[3];
        const int stored = (width + 31) / 32, end = width - margin;
        const int first = start > before ? start - before : 0;
        const int last = stop < before + height ? stop - before : height;
        int* const counted = counts.data + before;
        int* const marked = marks;
        marks += (size_t)height * stored;
        before += height;
        if (first >= last) continue;
        const long w = width;
        const long at[16] = {-3 * w,    -3 * w + 1, -2 * w + 2, -w + 3,    3,         w + 3,
                             2 * w + 2, 3 * w + 1,  3 * w,      3 * w - 1, 2 * w - 2, w - 3,
                             -3,        -w - 3,     -2 * w - 2, -3 * w - 1};
        __builtin_memset(base - N, 0, 3 * (size_t)pitch);
        for (int row = first - 1; row <= last; ++row) {
            byte* const out = base + (row + 3) % 3 * pitch;
            if (row < margin || row >= height - margin) {
                __builtin_memset(out, 0, pitch - 2 * N);
            } else {
                for (int x = margin / N * N; x < end; x += N) {
                    const byte* const c = src + (size_t)row * width + x;
                    lanes v, p[16], result = {};
                    __builtin_memcpy(&v, c, N);
                    __builtin_prefetch(c + 5 * w);
#pragma unroll
                    for (int k = 0; k < 16; k += 4) __builtin_memcpy(&p[k], c + at[k], N);
                    const lanes above = __builtin_elementwise_add_sat(v, least);
                    const lanes below = __builtin_elementwise_sub_sat(v, least);
                    // 9 neighbours have one of each two that face each other.
                    lanes high = __builtin_elementwise_max(p[0], p[8]);
                    lanes low = __builtin_elementwise_min(p[0], p[8]);
                    high = __builtin_elementwise_min(high, __builtin_elementwise_max(p[4], p[12]));
                    low = __builtin_elementwise_max(low, __builtin_elementwise_min(p[4], p[12]));
                    const lanes may = either((lanes)(high > above), (lanes)(low < below));
                    if (__builtin_reduce_or(may)) {
#pragma unroll
                        for (int k = 0; k < 16; ++k)
                            if (k % 4) __builtin_memcpy(&p[k], c + at[k], N);
                        // The least and the largest of 2, 4 and 8 neighbours from each odd place
                        // on, and the better one of the two pixels beside the 8.
                        lanes bright = {}, dark = (lanes){} + (byte)255, a[3][8], b[3][8];
#pragma unroll
                        for (int k = 0; k < 8; ++k) {
                            const lanes one = p[2 * k + 1], other = p[(2 * k + 2) % 16];
                            a[0][k] = __builtin_elementwise_min(one, other);
                            b[0][k] = __builtin_elementwise_max(one, other);
                        }
#pragma unroll
                        for (int n = 0; n < 2; ++n)
#pragma unroll
                            for (int k = 0; k < 8; ++k) {
                                const int next = (k + 1 + n) % 8;
                                a[n + 1][k] = __builtin_elementwise_min(a[n][k], a[n][next]);
                                b[n + 1][k] = __builtin_elementwise_max(b[n][k], b[n][next]);
                            }
#pragma unroll
                        for (int k = 0; k < 8; ++k) {
                            const lanes one = p[2 * k], other = p[(2 * k + 9) % 16];
                            const lanes most = __builtin_elementwise_max(one, other);
                            const lanes fewest = __builtin_elementwise_min(one, other);
                            bright = __builtin_elementwise_max(
                                bright, __builtin_elementwise_min(a[2][k], most));
                            dark = __builtin_elementwise_min(
                                dark, __builtin_elementwise_max(b[2][k], fewest));
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
            int* const to = marked + (size_t)y * stored;
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
            counted[y] = total;
        }
    }
}

// List the marked pixels of rows, and Harris' measure over 7 x 7 pixels, times 25, of each. The
// rows `i` and `i + 4` of the nine that this takes are halves of a vector.
void list_rows(int start, int stop, wp::array_t<wp::int64> images, wp::array_t<int> words,
               wp::array_t<int> ends, wp::array_t<int> cells, wp::array_t<wp::int64> responses) {
    typedef unsigned char bytes __attribute__((vector_size(16)));
    typedef short lanes __attribute__((vector_size(32)));
    typedef short half __attribute__((vector_size(16)));
    typedef int wide __attribute__((vector_size(32)));
    // Sums of the products of two neighbours.
    const auto products = [](lanes a, lanes b) -> wide {
#if defined(__AVX2__)
        typedef short own __attribute__((vector_size(32)));
        return (wide)__builtin_ia32_pmaddwd256((own)a, (own)b);
#else
        const auto evens = [](lanes v) {
            return __builtin_convertvector(__builtin_shufflevector(v, v, 0, 2, 4, 6, 8, 10, 12, 14),
                                           wide);
        };
        const auto odds = [](lanes v) {
            return __builtin_convertvector(__builtin_shufflevector(v, v, 1, 3, 5, 7, 9, 11, 13, 15),
                                           wide);
        };
        return evens(a) * evens(b) + odds(a) * odds(b);
#endif
    };
    const lanes seven = {-1, -1, -1, -1, -1, -1, -1, 0, -1, -1, -1, -1, -1, -1, -1, 0};
    const lanes lower = {-1, -1, -1, -1, -1, -1, -1, 0};
    const int* marks = words.data;
    for (int image = 0, before = 0; image < images.shape[0] && before < stop; ++image) {
        const wp::int64* const entry = images.data + 4 * image;
        const unsigned char* const src = (const unsigned char*)entry[0];
        const int height = (int)entry[2], width = (int)entry[3], stored = (width + 31) / 32;
        const int first = start > before ? start - before : 0;
        const int last = stop < before + height ? stop - before : height;
        for (int row = first; row < last; ++row) {
            int at = before + row > 0 ? ends.data[before + row - 1] : 0;
            if (at == ends.data[before + row]) continue;
            // The last row of those that the next row's corners read.
            for (int x = 0; x < width; x += 64)
                __builtin_prefetch(src + (row + 5) * (size_t)width + x);
            for (int k = 0; k < stored; ++k) {
                unsigned word = (unsigned)marks[(size_t)row * stored + k];
                for (; word; word &= word - 1, ++at) {
                    const int column = 32 * k + __builtin_ctz(word);
                    const unsigned char* const c = src + (row - 4) * (size_t)width + column - 4;
                    lanes sums[5], slopes[5];
#pragma unroll
                    for (int i = 0; i < 5; ++i) {
                        lanes parts[3];
#pragma unroll
                        for (int j = 0; j < 3; ++j) {
                            bytes pair;
                            __builtin_memcpy(&pair, c + (size_t)i * width + j, 8);
                            __builtin_memcpy((unsigned char*)&pair + 8,
                                             c + (size_t)(i + 4) * width + j, 8);
                            parts[j] = __builtin_convertvector(pair, lanes);
                        }
                        sums[i] = parts[0] + 2 * parts[1] + parts[2];
                        slopes[i] = parts[2] - parts[0];
                    }
                    wide yy = {}, xx = {}, xy = {};
                    const auto add = [&](lanes gy, lanes gx, lanes used) {
                        gy &= used;
                        gx &= used;
                        yy += products(gy, gy);
                        xx += products(gx, gx);
                        xy += products(gy, gx);
                    };
#pragma unroll
                    for (int i = 1; i < 4; ++i)
                        add(sums[i + 1] - sums[i - 1],
                            slopes[i - 1] + 2 * slopes[i] + slopes[i + 1], seven);
                    // The row in the middle is between row 3, a lower half, and 5, an upper one.
                    const auto upper = [](lanes v) {
                        return __builtin_shufflevector(v, v, 8, 9, 10, 11, 12, 13, 14, 15, 8, 9, 10,
                                                       11, 12, 13, 14, 15);
                    };
                    add(upper(sums[1]) - sums[3], slopes[3] + 2 * slopes[4] + upper(slopes[1]),
                        lower);
                    const long long a = __builtin_reduce_add(yy), b = __builtin_reduce_add(xx);
                    const long long c2 = __builtin_reduce_add(xy);
                    int* const cell = cells.data + 4 * (size_t)at;
                    cell[0] = image, cell[1] = 1, cell[2] = row, cell[3] = column;
                    responses.data[at] = 25 * (a * b - c2 * c2) - (a + b) * (a + b);
                }
            }
        }
        marks += (size_t)height * stored;
        before += height;
    }
}

// needs DISC, BLUR, TAPS, REACH, PITCH, PAIRS, TURNS, TURNS_PER_RADIAN
// Direction of point `k` by the moments of a disc, and its bits: pairs of pixels compared, of the
// smoothed image.
void describe_one(int k, wp::array_t<wp::int64> images, wp::array_t<int> cells,
                  wp::array_t<wp::int16> pattern, int upright, wp::array_t<float> angles,
                  wp::array_t<wp::uint8> descriptors) {
#pragma clang fp contract(off)
    typedef unsigned char byte;
    enum { SIDE = 2 * REACH + 1, READ = SIDE + 2 * BLUR, N = 32, WIDE = 16, ALL = 64 };
    typedef byte bytes __attribute__((vector_size(N)));
    typedef short lanes __attribute__((vector_size(2 * N)));
    typedef int wide __attribute__((vector_size(4 * N)));
    typedef unsigned short sums __attribute__((vector_size(2 * N)));
    typedef float reals __attribute__((vector_size(4 * N)));
    typedef float line __attribute__((vector_size(4 * WIDE)));
    typedef int whole __attribute__((vector_size(4 * WIDE)));
    typedef byte few __attribute__((vector_size(WIDE)));
    typedef byte all __attribute__((vector_size(ALL)));
    typedef bool flags __attribute__((ext_vector_type(ALL)));
    const int taps[] = {TAPS};
    const int* const cell = cells.data + 4 * (size_t)k;
    const wp::int64* const image = images.data + 4 * (size_t)cell[0];
    const size_t width = (size_t)image[3];
    const byte* const middle = (const byte*)image[0] + (size_t)cell[2] * width + cell[3];
    if (k + 1 < cells.shape[0]) {  // what the next point reads
        const int* const next = cell + 4;
        const wp::int64* const other = images.data + 4 * (size_t)next[0];
        const byte* p = (const byte*)other[0] + (size_t)(next[2] - REACH - BLUR) * other[3] +
                        next[3] - REACH - BLUR;
        for (int i = 0; i < READ; ++i, p += other[3]) {
            __builtin_prefetch(p);
            __builtin_prefetch(p + READ - 1);
        }
    }
    float angle = 0.0f;
    int turn = 0;
    if (!upright) {
        // Sums of 31 bytes, and those times -15 to 15, fit into 16 bits.
        lanes along = {}, down = {}, column;
        for (int j = 0; j < N; ++j) column[j] = (short)(j - DISC);
        const lanes squares = column * column;
        for (int i = -DISC; i <= DISC; ++i) {
            bytes v;
            __builtin_memcpy(&v, middle + i * (long)width - DISC, N);
            const lanes in = (lanes)(squares <= (short)(DISC * (DISC + 1) - i * i));
            const lanes values = __builtin_convertvector(v, lanes) & in;
            along += values;
            down += (short)i * values;
        }
        const int y = __builtin_reduce_add(__builtin_convertvector(down, wide));
        const int x = __builtin_reduce_add(__builtin_convertvector(along, wide) *
                                           __builtin_convertvector(column, wide));
        angle = Alike::angle((float)y, (float)x);
        turn = (int)__builtin_floorf(angle * TURNS_PER_RADIAN + 0.5f) & (TURNS - 1);
    }
    angles.data[k] = angle;
    // All sums are integers of at most 24 bits, so that those of floats are exact.
    const byte* const corner = middle - (REACH + BLUR) * (long)(width + 1);
    sums read[READ];
    float values[SIDE][READ];
    byte smooth[SIDE][PITCH];
    const int begins[2] = {0, READ - N}, parts[3] = {0, WIDE, SIDE - WIDE};
#pragma unroll
    for (int b = 0; b < 2; ++b) {
        for (int i = 0; i < READ; ++i) {
            bytes v;
            __builtin_memcpy(&v, corner + i * width + begins[b], N);
            read[i] = __builtin_convertvector(v, sums);
        }
        for (int i = 0; i < SIDE; ++i) {
            sums sum = (unsigned short)taps[BLUR] * read[i + BLUR];
#pragma unroll
            for (int t = 0; t < BLUR; ++t)
                sum += (unsigned short)taps[t] * (read[i + t] + read[i + 2 * BLUR - t]);
            const reals real = __builtin_convertvector(sum, reals);
            __builtin_memcpy(values[i] + begins[b], &real, sizeof real);
        }
    }
    for (int i = 0; i < SIDE; ++i)
#pragma unroll
        for (int b = 0; b < 3; ++b) {
            line v[2 * BLUR + 1];
#pragma unroll
            for (int t = 0; t <= 2 * BLUR; ++t)
                __builtin_memcpy(&v[t], values[i] + parts[b] + t, sizeof v[t]);
            line sum = (float)taps[BLUR] * v[BLUR] + 32768.0f;
#pragma unroll
            for (int t = 0; t < BLUR; ++t) sum += (float)taps[t] * (v[t] + v[2 * BLUR - t]);
            const few done =
                __builtin_convertvector(__builtin_convertvector(sum, whole) >> 16, few);
            __builtin_memcpy(smooth[i] + parts[b], &done, WIDE);
        }
    const byte* const centre = &smooth[REACH][REACH];
    const short* const places = pattern.data + (size_t)turn * PAIRS * 2;
    byte ones[PAIRS], others[PAIRS];
#pragma clang loop vectorize(disable)
    for (int p = 0; p < PAIRS; ++p) {
        ones[p] = centre[places[2 * p]];
        others[p] = centre[places[2 * p + 1]];
    }
#pragma unroll
    for (int p = 0; p < PAIRS; p += ALL) {
        all one, other;
        __builtin_memcpy(&one, ones + p, ALL);
        __builtin_memcpy(&other, others + p, ALL);
        const flags set = __builtin_convertvector((all)(one < other), flags);
        __builtin_memcpy(descriptors.data + ((size_t)k * PAIRS + p) / 8, &set, ALL / 8);
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
