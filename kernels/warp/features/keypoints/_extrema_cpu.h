// Doubling, differences and extrema of a scale space on the CPU, row by row;
// taichi/features/keypoints/extrema.py has the rules.

// Twice the size of an image: pixels lie on even places, means between them. A row of the result.
void double_row(int row, wp::array_t<float> src, wp::array_t<float> dst) {
#pragma clang fp contract(off)
    const int height = src.shape[0], width = src.shape[1], y = row / 2;
    const int below = y + 1 < height ? y + 1 : height - 1;
    const float* a = src.data + (size_t)y * width;
    const float* b = src.data + (size_t)(row % 2 ? below : y) * width;
    float* out = dst.data + (size_t)row * 2 * width;
    float last = 0.5f * (a[0] + b[0]);
    for (int x = 0; x < width - 1; ++x) {
        const float next = 0.5f * (a[x + 1] + b[x + 1]);
        out[2 * x] = last;
        out[2 * x + 1] = 0.5f * (last + next);
        last = next;
    }
    out[2 * width - 2] = last;
    out[2 * width - 1] = last;
}

// Mark the extrema of a row of every inner level: a bit for each pixel, and their number. Pixels
// drop out at the first neighbours that exceed them, those of their own level first, and 32 pixels
// are left at once.
void mark_row(int row, wp::array_t<float> levels, float threshold, int margin,
              wp::array_t<int> words, wp::array_t<int> counts) {
#pragma clang fp contract(off)
    enum { N = 32 };
    typedef float lanes __attribute__((vector_size(4 * N)));
    typedef unsigned whole __attribute__((vector_size(4 * N)));
    typedef bool flags __attribute__((ext_vector_type(N)));
    const int count = levels.shape[0] - 1, height = levels.shape[1], width = levels.shape[2];
    const int stored = words.shape[2];
    const size_t plane = (size_t)height * width;
    const bool none = row < margin || row >= height - margin;
    for (int s = 1; s < count - 1; ++s) {
        int* const out = words.data + ((size_t)(s - 1) * height + row) * stored;
        const float* const line = levels.data + s * plane + (size_t)row * width;
        int total = 0;
        for (int k = 0; k < stored; ++k) {
            out[k] = 0;
            const int left = k * N < margin ? margin : k * N;
            const int right = (k + 1) * N < width - margin ? (k + 1) * N : width - margin;
            if (none || left >= right) continue;
            // Loads beyond the end of the row reach into the next row, which always exists.
            const float* const a = line + k * N;
            // Load rows ahead: all rows of the first level, later only the new ones.
            for (long l = s == 1 ? -1 : 2; l <= 2; ++l) {
                __builtin_prefetch(a + l * (long)plane + 2 * width);
                __builtin_prefetch(a + l * (long)plane + 2 * width + 16);
            }
            const auto difference = [&](long at) {
                lanes low, high;
                __builtin_memcpy(&low, a + at, sizeof low);
                __builtin_memcpy(&high, a + at + plane, sizeof high);
                return high - low;
            };
            const lanes v = difference(0);
            // With their signs turned, minima are maxima.
            const whole sign = (whole)v & 0x80000000u;
            const lanes top = (lanes)((whole)v ^ sign);
            const auto exceeded = [&](long at) {
                return (whole)(top >= (lanes)((whole)difference(at) ^ sign));
            };
            const auto any = [](whole found) {
                const flags set = __builtin_convertvector(found, flags);
                unsigned word;
                __builtin_memcpy(&word, &set, sizeof word);
                return word;
            };
            whole found = (whole)(top > threshold);
            if (!any(found)) continue;
            found &= exceeded(-1) & exceeded(1);
            if (!any(found)) continue;
            const long w = width, p = (long)plane;
            found &= exceeded(-w) & exceeded(w);
            if (!any(found)) continue;
            found &= exceeded(-w - 1) & exceeded(-w + 1) & exceeded(w - 1) & exceeded(w + 1);
            if (!any(found)) continue;
            found &= exceeded(-p) & exceeded(p);
            if (!any(found)) continue;
#pragma unroll
            for (int i = -1; i <= 1; ++i)
#pragma unroll
                for (int j = -1; j <= 1; ++j)
                    if (i || j) found &= exceeded(i * w + j - p) & exceeded(i * w + j + p);
            const unsigned behind = right - k * N < N ? 1u << (right - k * N) : 0u;
            out[k] = (int)(any(found) & (behind - 1u) & ~0u << (left - k * N));
            total += __builtin_popcount((unsigned)out[k]);
        }
        counts.data[(s - 1) * height + row] = total;
    }
}

// Every second pixel of a row.
void halve_row(int row, wp::array_t<float> src, wp::array_t<float> dst) {
    const float* from = src.data + 2 * (size_t)row * src.shape[1];
    float* to = dst.data + (size_t)row * dst.shape[1];
    const int width = dst.shape[1];
#pragma clang loop vectorize(assume_safety)
    for (int x = 0; x < width; ++x) to[x] = from[2 * x];
}

// needs SCALAR, RED, GREEN, BLUE, MOST_GRAY
// Grey values of a row, times `scale`.
void gray_row(int row, wp::array_t<SCALAR> src, float scale, wp::array_t<float> dst) {
#pragma clang fp contract(off)
    const int width = dst.shape[1], channels = src.shape[2];
    const SCALAR* from = src.data + (size_t)row * width * channels;
    float* to = dst.data + (size_t)row * width;
    if (channels == 1)
        for (int x = 0; x < width; ++x) to[x] = (float)from[x] * scale;
    else
        for (int x = 0; x < width; ++x, from += channels)
            to[x] = (RED * (float)from[0] + GREEN * (float)from[1] + BLUE * (float)from[2]) * scale;
    // NaN as well.
    for (int x = 0; x < width; ++x) to[x] = __builtin_fabsf(to[x]) <= MOST_GRAY ? to[x] : 0.0f;
}
