#include "_distortion.h"

// Undistorted rows on the CPU. The map, and for bytes the weighing, are loops without branches;
// between them, pixels are fetched.

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
    SCALAR* to = dst.data + (size_t)i * columns * CHANNELS;
    const size_t below = (size_t)width * CHANNELS;
    enum {
        PART = 256,
        HALF = SEGMENT / 2,
        NODES = PART / HALF + 8
    };  // more than one: whole vectors
    float node_u[NODES], node_v[NODES];
    int seen[PART], place[PART], met[NODES];
#if BYTES
    int along[PART], down[PART];
    unsigned short tops[PART * CHANNELS], lows[PART * CHANNELS];
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
        place[k] = (y0 * width + x0) * CHANNELS;
#if BYTES
        along[k] = ix - (x0 << 8), down[k] = iy - (y0 << 8);
#else
        along[k] = x - (float)x0, down[k] = y - (float)y0;
#endif
    };
    for (int begin = 0; begin < columns; begin += PART) {
        const int count = columns - begin < PART ? columns - begin : PART;
#pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < NODES; ++k) {
            float u, v;
            met[k] = lens.see((float)(begin + k * HALF), u, v);
            node_u[k] = u, node_v[k] = v;
        }
        for (int s = 0; SEGMENT * s < count; ++s) {
            const float *p = node_u + 2 * s, *q = node_v + 2 * s;
            if (whole & met[2 * s] & met[2 * s + 2]) {
                const float u0 = p[0], v0 = q[0];
                float a, b, c, d;
                Lens::bend(p[0], p[1], p[2], a, b);
                Lens::bend(q[0], q[1], q[2], c, d);
#pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < SEGMENT; ++k) {
                    const float t = (float)k;
                    locate(SEGMENT * s + k, u0 + t * (a + t * b), v0 + t * (c + t * d), true);
                }
            } else {
#pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < SEGMENT; ++k) {
                    float u, v;
                    const bool in = lens.see((float)(begin + SEGMENT * s + k), u, v);
                    locate(SEGMENT * s + k, u, v, in);
                }
            }
        }
#if BYTES
        // A pixel and the one to its right, in one number of two bytes.
        for (int k = 0; k < count; ++k) {
            const SCALAR* a = src.data + place[k];
            const SCALAR* b = a + below;
            if (CHANNELS == 1) {  // they lie side by side, as processors order bytes
                __builtin_memcpy(&tops[k], a, 2);
                __builtin_memcpy(&lows[k], b, 2);
            } else {
                for (int c = 0; c < CHANNELS; ++c) {
                    tops[k * CHANNELS + c] = (unsigned short)(a[c] | a[c + CHANNELS] << 8);
                    lows[k * CHANNELS + c] = (unsigned short)(b[c] | b[c + CHANNELS] << 8);
                }
            }
        }
        for (int k = 0; k < count; ++k)
            for (int c = 0; c < CHANNELS; ++c) {
                const int a = tops[k * CHANNELS + c], b = lows[k * CHANNELS + c];
                const int top = ((a & 255) << 8) + along[k] * ((a >> 8) - (a & 255));
                const int low = ((b & 255) << 8) + along[k] * ((b >> 8) - (b & 255));
                const int v = ((top << 8) + down[k] * (low - top) + 32768) >> 16;
                to[(begin + k) * CHANNELS + c] = (SCALAR)(seen[k] ? v : outside);
            }
#else
        for (int k = 0; k < count; ++k) {
            const SCALAR* a = src.data + place[k];
            const SCALAR* b = a + below;
            for (int c = 0; c < CHANNELS; ++c) {
                const float top = a[c] + along[k] * (a[c + CHANNELS] - a[c]);
                const float low = b[c] + along[k] * (b[c + CHANNELS] - b[c]);
                const float v = top + down[k] * (low - top);
                to[(begin + k) * CHANNELS + c] = seen[k] ? v : outside;
            }
        }
#endif
    }
}
