// Smooth rows by the same taps down the rows and then along them, sums in the order of the taps;
// the image is mirrored about its outermost pixels. Two rows are done together, as they share most
// of what they read. Between the passes they stand in lines, pixel 0 at element `margin`.
void smooth_rows(int slab, int first, int last, wp::array_t<float> src, wp::array_t<float> taps,
                 int margin, wp::array_t<float> lines, wp::array_t<float> dst) {
#pragma clang fp contract(off)
    // Loads that are not aligned are quicker in halves of a line of the cache.
    enum { N = 8, TALL = 4, LONG = 8 };
    typedef float lanes __attribute__((vector_size(N * sizeof(float))));
    const int height = src.shape[0], width = src.shape[1], n = taps.shape[0], reach = n / 2;
    const float* const tap = taps.data;
    float* const line = lines.data + (size_t)slab * 2 * lines.shape[1] + margin;
    const int pitch = lines.shape[1];
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
            const float* const top = src.data + (size_t)(row - reach) * width;
            for (int x = 0; x < width; x += N * TALL) {
                const int at = x + N * TALL < width ? x : width - N * TALL;
                const float* p = top + at;
                lanes one[TALL], other[TALL], v;
#pragma unroll
                for (int b = 0; b < TALL; ++b) {
                    __builtin_memcpy(&v, p + N * b, sizeof v);
                    one[b] = tap[0] * v;
                    other[b] = (lanes){};
                }
#pragma clang loop unroll_count(2)
                for (int t = 1; t < n; ++t) {
                    p += width;
                    const float w = tap[t], before = tap[t - 1];
#pragma unroll
                    for (int b = 0; b < TALL; ++b) {
                        __builtin_memcpy(&v, p + N * b, sizeof v);
                        one[b] += w * v;
                        other[b] += before * v;
                    }
                }
                p += width;
                // The rows that the next pair reads first.
                __builtin_prefetch(p + width);
                __builtin_prefetch(p + 2 * width);
                __builtin_prefetch(p + width + 16);
                __builtin_prefetch(p + 2 * width + 16);
#pragma unroll
                for (int b = 0; b < TALL; ++b) {
                    __builtin_memcpy(&v, p + N * b, sizeof v);
                    other[b] += tap[n - 1] * v;
                    __builtin_memcpy(line + at + N * b, &one[b], sizeof v);
                    __builtin_memcpy(line + pitch + at + N * b, &other[b], sizeof v);
                }
            }
        } else {
            for (int x = 0; x < width; ++x) line[x] = 0.0f;
            for (int t = 0; t < n; ++t) {
                const int y = row - reach + t;
                const float* p = src.data + (size_t)(inside ? y : mirrored(y, height)) * width;
#pragma clang loop vectorize(assume_safety)
                for (int x = 0; x < width; ++x) line[x] += tap[t] * p[x];
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
                    const float* p = from + at - reach;
                    lanes sums[LONG] = {}, v;
#pragma clang loop unroll_count(2)
                    for (int t = 0; t < n; ++t, ++p) {
                        const float w = tap[t];
#pragma unroll
                        for (int b = 0; b < LONG; ++b) {
                            __builtin_memcpy(&v, p + N * b, sizeof v);
                            sums[b] += w * v;
                        }
                    }
#pragma unroll
                    for (int b = 0; b < LONG; ++b)
                        __builtin_memcpy(to + at + N * b, &sums[b], sizeof v);
                }
            } else {
                for (int x = 0; x < width; ++x) {
                    float sum = 0.0f;
                    for (int t = 0; t < n; ++t) sum += tap[t] * from[x - reach + t];
                    to[x] = sum;
                }
            }
        }
        row += pair && wide ? 2 : 1;
    }
}
