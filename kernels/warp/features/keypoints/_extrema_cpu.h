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

// Mark the extrema of a row of every inner level: a bit for each pixel.
void mark_row(int row, int slab, wp::array_t<float> levels, float threshold, int margin,
              wp::array_t<float> lines, wp::array_t<int> words) {
#pragma clang fp contract(off)
    const int count = levels.shape[0] - 1, height = levels.shape[1], width = levels.shape[2];
    const int stored = words.shape[2];
    const size_t plane = (size_t)height * width;
    for (int s = 0; s < count - 2; ++s)
        for (int k = 0; k < stored; ++k) words.data[((size_t)s * height + row) * stored + k] = 0;
    if (row < margin || row >= height - margin) return;
    // Each difference of two levels: its maxima and minima of 3 x 3 pixels.
    float* line = lines.data + (size_t)slab * lines.shape[1];
    float* __restrict__ high = line;
    float* __restrict__ low = line + width;
    float* tops = line + 2 * (size_t)width;
    for (int l = 0; l < count; ++l) {
        const float* a = levels.data + l * plane + (size_t)row * width;
        const float* b = a + plane;
        const float *a0 = a - width, *a2 = a + width, *b0 = b - width, *b2 = b + width;
#pragma clang loop vectorize(assume_safety)
        for (int x = 0; x < width; ++x) {
            const float u = b0[x] - a0[x], v = b[x] - a[x], w = b2[x] - a2[x];
            const float m = u > v ? u : v, n = u < v ? u : v;
            high[x] = m > w ? m : w;
            low[x] = n < w ? n : w;
        }
        float* __restrict__ top = tops + (size_t)(2 * l) * width;
        float* __restrict__ bottom = top + width;
#pragma clang loop vectorize(assume_safety)
        for (int x = 1; x < width - 1; ++x) {
            const float m = high[x - 1] > high[x] ? high[x - 1] : high[x];
            const float n = low[x - 1] < low[x] ? low[x - 1] : low[x];
            top[x] = m > high[x + 1] ? m : high[x + 1];
            bottom[x] = n < low[x + 1] ? n : low[x + 1];
        }
    }
    unsigned char* __restrict__ marks = (unsigned char*)line;  // the first line is free by now
    for (int s = 1; s < count - 1; ++s) {
        const float* a = levels.data + s * plane + (size_t)row * width;
        const float* b = a + plane;
        const float* t = tops + (size_t)(2 * s - 2) * width;
        const size_t w2 = 2 * (size_t)width;
        const float *t0 = t, *t1 = t + w2, *t2 = t + 2 * w2;
        const float *l0 = t + width, *l1 = l0 + w2, *l2 = l1 + w2;
#pragma clang loop vectorize(assume_safety)
        for (int x = 1; x < width - 1; ++x) {
            const float v = b[x] - a[x];
            const int above = (v > threshold) & (v >= t0[x]) & (v >= t1[x]) & (v >= t2[x]);
            const int below = (v < -threshold) & (v <= l0[x]) & (v <= l1[x]) & (v <= l2[x]);
            marks[x] = above | below;
        }
        int* out = words.data + ((size_t)(s - 1) * height + row) * stored;
        int x = margin;
        while (x < width - margin) {
            unsigned long long eight;
            if (x + 8 <= width - margin) {
                __builtin_memcpy(&eight, marks + x, 8);
                if (!eight) {
                    x += 8;
                    continue;
                }
            }
            const int end = x + 8 < width - margin ? x + 8 : width - margin;
            for (; x < end; ++x)
                if (marks[x]) out[x >> 5] |= (int)(1u << (x & 31));
        }
    }
}

// Bits that are set in a row of words.
int ones_of_row(int row, wp::array_t<int> words) {
    const int* from = words.data + (size_t)row * words.shape[1];
    int total = 0;
    for (int k = 0; k < words.shape[1]; ++k) total += __builtin_popcount((unsigned)from[k]);
    return total;
}

// Every second pixel of a row.
void halve_row(int row, wp::array_t<float> src, wp::array_t<float> dst) {
    const float* from = src.data + 2 * (size_t)row * src.shape[1];
    float* to = dst.data + (size_t)row * dst.shape[1];
    for (int x = 0; x < dst.shape[1]; ++x) to[x] = from[2 * x];
}

// needs RED, GREEN, BLUE, MOST_GRAY
// Grey values of a row, times `scale`.
void gray_row(int row, wp::array_t<float> src, float scale, wp::array_t<float> dst) {
#pragma clang fp contract(off)
    const int width = dst.shape[1], channels = src.shape[2];
    const float* from = src.data + (size_t)row * width * channels;
    float* to = dst.data + (size_t)row * width;
    if (channels == 1)
        for (int x = 0; x < width; ++x) to[x] = from[x] * scale;
    else
        for (int x = 0; x < width; ++x, from += channels)
            to[x] = (RED * from[0] + GREEN * from[1] + BLUE * from[2]) * scale;
    // NaN as well.
    for (int x = 0; x < width; ++x) to[x] = __builtin_fabsf(to[x]) <= MOST_GRAY ? to[x] : 0.0f;
}

int first_one(int word) { return __builtin_ctz((unsigned)word); }
