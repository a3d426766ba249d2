// Smooth rows by the same symmetric taps down the rows and then along them: the middle, then pairs
// of elements from the inner ones outwards; the image is mirrored about its outermost pixels. Two
// rows are done together, as they share most of what they read. Between the passes they stand in
// lines, pixel 0 at element `margin`.
void smooth_rows(int slab, int first, int last, wp::array_t<float> src, wp::array_t<float> taps,
                 int margin, wp::array_t<float> lines, wp::array_t<float> dst) {
#pragma clang fp contract(off)
#if defined(__AVX512F__)
    enum { N = 16, TALL = 2, LONG = 4 };
#else
    // Loads that are not aligned are quicker in halves of a line of the cache.
    enum { N = 8, TALL = 2, LONG = 8 };
#endif
    typedef float lanes __attribute__((vector_size(N * sizeof(float))));
    const int height = src.shape[0], width = src.shape[1], reach = taps.shape[0] / 2;
    const float* const tap = taps.data + reach;  // tap[t] for elements t away
    float* const line = lines.data + (size_t)slab * 2 * lines.shape[1] + margin;
    const int pitch = lines.shape[1];
    const auto load = [](const float* p) {
        lanes v;
        __builtin_memcpy(&v, p, sizeof v);
        return v;
    };
    // A parameter of this size allows registers of it in this function.
    const auto add = [](lanes a, lanes b) __attribute__((always_inline)) { return a + b; };
    const auto mirrored = [](int i, int size) {
        if (size == 1) return 0;
        const int period = 2 * (size - 1), k = (i % period + period) % period;
        return k < size ? k : period - k;
    };
    for (int row = first; row < last;) {
        const bool inside = row >= reach && row + reach < height;
        const bool pair = inside && row + 1 < last && row + 1 + reach < height;
        const bool wide = width >= N * LONG;
        if (pair && wide) {
            const float* const middle = src.data + (size_t)row * width;
            for (int x = 0; x < width; x += N * TALL) {
                const int at = x + N * TALL < width ? x : width - N * TALL;
                const float *up = middle + at, *down = up + width;
                // The rows above and below that one of both rows has read and the other has not.
                lanes one[TALL], other[TALL], above[TALL], below[TALL];
#pragma unroll
                for (int b = 0; b < TALL; ++b) {
                    above[b] = load(up + N * b), below[b] = load(down + N * b);
                    one[b] = tap[0] * above[b], other[b] = tap[0] * below[b];
                }
#pragma clang loop unroll_count(2)
                for (int t = 1; t <= reach; ++t) {
                    up -= width, down += width;
                    const float w = tap[t];
#pragma unroll
                    for (int b = 0; b < TALL; ++b) {
                        const lanes u = load(up + N * b), d = load(down + N * b);
                        one[b] = add(one[b], w * (u + below[b]));
                        other[b] = add(other[b], w * (above[b] + d));
                        above[b] = u, below[b] = d;
                    }
                }
                // The rows that the next pair reads first.
                __builtin_prefetch(down + width);
                __builtin_prefetch(down + 2 * width);
#pragma unroll
                for (int b = 0; b < TALL; ++b) {
                    __builtin_memcpy(line + at + N * b, &one[b], sizeof one[b]);
                    __builtin_memcpy(line + pitch + at + N * b, &other[b], sizeof other[b]);
                }
            }
        } else {
            const float* const middle = src.data + (size_t)row * width;
            for (int x = 0; x < width; ++x) line[x] = tap[0] * middle[x];
            for (int t = 1; t <= reach; ++t) {
                const int y = inside ? row - t : mirrored(row - t, height);
                const int z = inside ? row + t : mirrored(row + t, height);
                const float *p = src.data + (size_t)y * width, *q = src.data + (size_t)z * width;
#pragma clang loop vectorize(assume_safety)
                for (int x = 0; x < width; ++x) line[x] += tap[t] * (p[x] + q[x]);
            }
        }
        for (int k = 0; k <= (pair && wide); ++k) {
            float* const from = line + k * pitch;
            float* const to = dst.data + (size_t)(row + k) * width;
            for (int i = 1; i <= reach; ++i) {
                from[-i] = from[mirrored(-i, width)];
                from[width - 1 + i] = from[mirrored(width - 1 + i, width)];
            }
            if (wide) {
                for (int x = 0; x < width; x += N * LONG) {
                    const int at = x + N * LONG < width ? x : width - N * LONG;
                    const float* const p = from + at;
                    lanes sums[LONG];
#pragma unroll
                    for (int b = 0; b < LONG; ++b) sums[b] = tap[0] * load(p + N * b);
#pragma clang loop unroll_count(2)
                    for (int t = 1; t <= reach; ++t) {
                        const float w = tap[t];
                        const float *left = p - t, *right = p + t;
#pragma unroll
                        for (int b = 0; b < LONG; ++b)
                            sums[b] = add(sums[b], w * (load(left + N * b) + load(right + N * b)));
                    }
#pragma unroll
                    for (int b = 0; b < LONG; ++b)
                        __builtin_memcpy(to + at + N * b, &sums[b], sizeof sums[b]);
                }
            } else {
                for (int x = 0; x < width; ++x) {
                    float sum = tap[0] * from[x];
                    for (int t = 1; t <= reach; ++t) sum += tap[t] * (from[x - t] + from[x + t]);
                    to[x] = sum;
                }
            }
        }
        row += pair && wide ? 2 : 1;
    }
}
