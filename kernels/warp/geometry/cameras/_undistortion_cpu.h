#include "_distortion.h"

// Undistorted rows on the CPU. The map and the weighing are vector code; between them, pixels are
// fetched one by one.

// needs BYTES, SCALAR, CHANNELS, SEGMENT
// Row `i` of an image seen through a lens: for each pixel the place where it is seen, and the four
// pixels around that place.
void sample_row(int i, wp::array_t<SCALAR> src, wp::array_t<float> numbers, float cval,
                wp::array_t<SCALAR> dst) {
    const int height = src.shape[0], width = src.shape[1], columns = dst.shape[1];
    const Lens lens(numbers.data, (float)i);
    const bool whole = numbers.data[19] > 0.0f;
    const float last_x = (float)(width - 1), last_y = (float)(height - 1);
    const float limit = cval > 0.0f ? (cval < 255.0f ? cval : 255.0f) : 0.0f;
    const SCALAR outside = BYTES ? (SCALAR)(limit + 0.5f) : (SCALAR)cval;
    const int pitch = width * CHANNELS;
    SCALAR* const line = dst.data + (size_t)i * columns * CHANNELS;
    enum {
        PART = 256,
        HALF = SEGMENT / 2,
        NODES = PART / HALF + 16,
        PARABOLAS = PART / SEGMENT
    };  // nodes in whole vectors
    float node_u[NODES], node_v[NODES];
    int seen[PART], place[PART], met[NODES];
#if BYTES
    int along[PART], down[PART];
#else
    float along[PART], down[PART];
#endif
    // The pixels about a place, and how far it is from the first of them.
    const auto locate = [&](int k, float u, float v, bool met) {
        const bool in = met & (u >= 0.0f) & (v >= 0.0f) & (u <= last_x) & (v <= last_y);
        const float x = in ? u : 0.0f, y = in ? v : 0.0f;
        const int ix = BYTES ? (int)(x * 256.0f + 0.5f) : (int)x;
        const int iy = BYTES ? (int)(y * 256.0f + 0.5f) : (int)y;
        const int shift = BYTES ? 8 : 0;
        const int x0 = ix >> shift < width - 2 ? ix >> shift : width - 2;
        const int y0 = iy >> shift < height - 2 ? iy >> shift : height - 2;
        seen[k] = in;
        place[k] = y0 * pitch + x0 * CHANNELS;
#if BYTES
        along[k] = ix - (x0 << 8), down[k] = iy - (y0 << 8);
#else
        along[k] = x - (float)x0, down[k] = y - (float)y0;
#endif
    };
    // Eight bytes of a row are read if a pixel has three.
    const float lowest = last_y - (CHANNELS == 3 ? 1.5f : 0.5f);
    const int furthest = (height - (CHANNELS == 3 ? 2 : 1)) * pitch;
    for (int begin = 0; begin < columns; begin += PART) {
        const int count = columns - begin < PART ? columns - begin : PART;
#pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < NODES; ++k) {
            float u, v;
            met[k] = lens.see((float)(begin + k * HALF), u, v);
            node_u[k] = u, node_v[k] = v;
        }
        float a[PARABOLAS], b[PARABOLAS], c[PARABOLAS], d[PARABOLAS];
        int bends[PARABOLAS], inside[PARABOLAS];
#pragma clang loop vectorize(assume_safety)
        for (int s = 0; s < PARABOLAS; ++s) {
            const float *p = node_u + 2 * s, *q = node_v + 2 * s;
            Lens::bend(p[0], p[1], p[2], a[s], b[s]);
            Lens::bend(q[0], q[1], q[2], c[s], d[s]);
            bends[s] = whole & (met[2 * s] != 0) & (met[2 * s + 2] != 0);
            inside[s] = bends[s] & Lens::within(p[0], a[s], p[2], last_x - 0.5f) &
                        Lens::within(q[0], c[s], q[2], lowest);
        }
        for (int s = 0; SEGMENT * s < count; ++s) {
            const float u0 = node_u[2 * s], v0 = node_v[2 * s];
            const float u1 = a[s], u2 = b[s], v1 = c[s], v2 = d[s];
            if (BYTES && inside[s]) {
#if BYTES
#pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < SEGMENT; ++k) {
                    const float t = (float)k;
                    const int ix = (int)((u0 + t * (u1 + t * u2)) * 256.0f + 0.5f);
                    const int iy = (int)((v0 + t * (v1 + t * v2)) * 256.0f + 0.5f);
                    seen[SEGMENT * s + k] = 1;
                    place[SEGMENT * s + k] = (iy >> 8) * pitch + (ix >> 8) * CHANNELS;
                    along[SEGMENT * s + k] = ix & 255, down[SEGMENT * s + k] = iy & 255;
                }
#endif
                continue;
            }
            if (bends[s]) {
#pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < SEGMENT; ++k) {
                    const float t = (float)k;
                    locate(SEGMENT * s + k, u0 + t * (u1 + t * u2), v0 + t * (v1 + t * v2), true);
                }
            } else {
#pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < SEGMENT; ++k) {
                    float u, v;
                    const bool in = lens.see((float)(begin + SEGMENT * s + k), u, v);
                    locate(SEGMENT * s + k, u, v, in);
                }
            }
            // All of a segment may still be so far within.
            int all = 1;
            for (int k = SEGMENT * s; k < SEGMENT * (s + 1); ++k)
                all &= (seen[k] != 0) & (place[k] < furthest);
            inside[s] = all;
        }
        SCALAR* const to = line + (size_t)begin * CHANNELS;
#if BYTES && CHANNELS == 1
        // A pixel and the one to its right, in one number of two bytes, as processors order them.
        unsigned short tops[PART], lows[PART];
#pragma clang loop unroll_count(8)
        for (int k = 0; k < count; ++k) {
            const SCALAR* const from = src.data + place[k];
            __builtin_memcpy(&tops[k], from, 2);
            __builtin_memcpy(&lows[k], from + pitch, 2);
        }
#pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < count; ++k) {
            const int a = tops[k], b = lows[k];
            const int top = ((a & 255) << 8) + along[k] * ((a >> 8) - (a & 255));
            const int low = ((b & 255) << 8) + along[k] * ((b >> 8) - (b & 255));
            const int v = ((top << 8) + down[k] * (low - top) + 32768) >> 16;
            to[k] = (SCALAR)(seen[k] ? v : outside);
        }
#else
        for (int s = 0; SEGMENT * s < count; ++s) {
            const int first = SEGMENT * s, size = count - first < SEGMENT ? count - first : SEGMENT;
#if BYTES && CHANNELS > 2
            if (inside[s] && size == SEGMENT) {
                // Eight pixels at once, four numbers each.
                typedef unsigned wide __attribute__((vector_size(128)));
                typedef unsigned short halves __attribute__((vector_size(64)));
                typedef unsigned char taken __attribute__((vector_size(64)));
                typedef unsigned char bytes __attribute__((vector_size(32)));
                SCALAR found[SEGMENT * CHANNELS + 16];
#pragma unroll
                for (int k = 0; k < SEGMENT; k += 8) {
                    unsigned long long pairs[2][8], shares[2][8];
#pragma unroll
                    for (int n = 0; n < 8; ++n) {
                        const SCALAR* const from = src.data + place[first + k + n];
                        __builtin_memcpy(&pairs[0][n], from, 8);
                        __builtin_memcpy(&pairs[1][n], from + pitch, 8);
                        shares[0][n] = along[first + k + n] * 0x0001000100010001ull;
                        shares[1][n] = down[first + k + n] * 0x0001000100010001ull;
                    }
                    halves x, y, lines[2];
                    __builtin_memcpy(&x, shares[0], sizeof x);
                    __builtin_memcpy(&y, shares[1], sizeof y);
#pragma unroll
                    for (int r = 0; r < 2; ++r) {
                        taken eight;
                        __builtin_memcpy(&eight, pairs[r], sizeof eight);
                        // A number and the one of the next pixel, as 16 bits.
                        enum { A = CHANNELS };
#define PAIRS(n) n, n + A, n + 1, n + A + 1, n + 2, n + A + 2, n + 3, n + A + (A == 4 ? 3 : 2)
                        const auto both = (halves)__builtin_shufflevector(
                            eight, eight, PAIRS(0), PAIRS(8), PAIRS(16), PAIRS(24), PAIRS(32),
                            PAIRS(40), PAIRS(48), PAIRS(56));
#undef PAIRS
                        lines[r] = (both & 255) * (256 - x) + (both >> 8) * x;
                    }
                    const wide sum =
                        __builtin_convertvector(lines[0], wide) *
                            __builtin_convertvector((halves)(256 - y), wide) +
                        __builtin_convertvector(lines[1], wide) * __builtin_convertvector(y, wide) +
                        32768u;
                    const bytes made = __builtin_convertvector(sum >> 16, bytes);
                    if (CHANNELS == 4) {
                        __builtin_memcpy(found + 4 * k, &made, sizeof made);
                    } else {
                        const bytes packed = __builtin_shufflevector(
                            made, made, 0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 16, 17, 18, 20, 21,
                            22, 24, 25, 26, 28, 29, 30, 30, 30, 30, 30, 30, 30, 30, 30);
                        __builtin_memcpy(found + 3 * k, &packed, sizeof packed);
                    }
                }
                __builtin_memcpy(to + first * CHANNELS, found, SEGMENT * CHANNELS);
                continue;
            }
#endif
            for (int k = first; k < first + size; ++k) {
                const SCALAR* const from = src.data + place[k];
                for (int n = 0; n < CHANNELS; ++n) {
#if BYTES
                    const int west = from[n], below = from[n + pitch];
                    const int top = (west << 8) + along[k] * (from[n + CHANNELS] - west);
                    const int low = (below << 8) + along[k] * (from[n + pitch + CHANNELS] - below);
                    const int v = ((top << 8) + down[k] * (low - top) + 32768) >> 16;
                    to[k * CHANNELS + n] = (SCALAR)(seen[k] ? v : outside);
#else
                    const float west = from[n], below = from[n + pitch];
                    const float top = west + along[k] * (from[n + CHANNELS] - west);
                    const float low = below + along[k] * (from[n + pitch + CHANNELS] - below);
                    const float v = top + down[k] * (low - top);
                    to[k * CHANNELS + n] = seen[k] ? v : outside;
#endif
                }
            }
        }
#endif
    }
}
