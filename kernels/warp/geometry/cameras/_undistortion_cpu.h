// Undistorted rows on the CPU; undistortion.py has the equations. The map, and for bytes the
// weighing, are loops without branches over 256 pixels; between them, pixels are fetched.

// needs BYTES, SCALAR, CHANNELS
// Row `i` of an image seen through a lens: for each pixel the ray of the new camera, turned to the
// old one, bent by its lens, and the four pixels around the place where it is seen.
void sample_row(int i, wp::array_t<SCALAR> src, wp::array_t<float> numbers, float cval,
                wp::array_t<SCALAR> dst) {
    const int height = src.shape[0], width = src.shape[1], columns = dst.shape[1];
    const float* n = numbers.data;
    const float n0 = n[0], n3 = n[3], n6 = n[6];
    const float px = n[1] * (float)i + n[2], py = n[4] * (float)i + n[5],
                pz = n[7] * (float)i + n[8];
    const float fx = n[9], fy = n[10], cx = n[11], cy = n[12];
    const float k1 = n[13], k2 = n[14], p1 = n[15], p2 = n[16], k3 = n[17], widest = n[18];
    const float last_x = (float)(width - 1), last_y = (float)(height - 1);
    const float limit = cval > 0.0f ? (cval < 255.0f ? cval : 255.0f) : 0.0f;
    const SCALAR outside = BYTES ? (SCALAR)(limit + 0.5f) : (SCALAR)cval;
    SCALAR* to = dst.data + (size_t)i * columns * CHANNELS;
    const size_t below = (size_t)width * CHANNELS;
    enum { PART = 256 };
    float us[PART], vs[PART];
    int seen[PART], place[PART];
#if BYTES
    int along[PART], down[PART];
    unsigned short tops[PART * CHANNELS], lows[PART * CHANNELS];
#endif
    for (int begin = 0; begin < columns; begin += PART) {
        const int count = columns - begin < PART ? columns - begin : PART;
        for (int k = 0; k < count; ++k) {
            const float j = (float)(begin + k);
            const float z = n6 * j + pz;
            const float w = 1.0f / z;
            const float x = (n0 * j + px) * w, y = (n3 * j + py) * w;
            const float xx = x * x, yy = y * y, xy = x * y, r2 = xx + yy;
            const float radial = 1.0f + r2 * (k1 + r2 * (k2 + r2 * k3));
            const float u = fx * (x * radial + (2.0f * (p1 * xy) + p2 * (r2 + 2.0f * xx))) + cx;
            const float v = fy * (y * radial + (p1 * (r2 + 2.0f * yy) + 2.0f * (p2 * xy))) + cy;
            const int in = (z > 0.0f) & (r2 < widest) & (u >= 0.0f) & (v >= 0.0f) & (u <= last_x) &
                           (v <= last_y);
            seen[k] = in;
            us[k] = in ? u : 0.0f;
            vs[k] = in ? v : 0.0f;
        }
#if BYTES
        for (int k = 0; k < count; ++k) {
            const int ix = (int)(us[k] * 256.0f + 0.5f), iy = (int)(vs[k] * 256.0f + 0.5f);
            const int x0 = (ix >> 8) < width - 2 ? ix >> 8 : width - 2;
            const int y0 = (iy >> 8) < height - 2 ? iy >> 8 : height - 2;
            place[k] = (y0 * width + x0) * CHANNELS;
            along[k] = ix - (x0 << 8);
            down[k] = iy - (y0 << 8);
        }
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
            const int ix = (int)us[k], iy = (int)vs[k];
            const int x0 = ix < width - 2 ? ix : width - 2, y0 = iy < height - 2 ? iy : height - 2;
            place[k] = (y0 * width + x0) * CHANNELS;
            us[k] -= (float)x0;
            vs[k] -= (float)y0;
        }
        for (int k = 0; k < count; ++k) {
            const SCALAR* a = src.data + place[k];
            const SCALAR* b = a + below;
            for (int c = 0; c < CHANNELS; ++c) {
                const float top = a[c] + us[k] * (a[c + CHANNELS] - a[c]);
                const float low = b[c] + us[k] * (b[c + CHANNELS] - b[c]);
                const float v = top + vs[k] * (low - top);
                to[(begin + k) * CHANNELS + c] = seen[k] ? v : outside;
            }
        }
#endif
    }
}
