// Resizing on the CPU, both passes in tiles of 16 rows; resampling.py has the equation.

// needs ROUNDED
// 16 rows of an image of another size. Tiles are weighed down the rows, then turned, so that 16
// pixels below each other, which share their weights along the row, are a vector. Starts do not
// descend.
void resample_rows(int group, wp::array_t<float> src, wp::array_t<int> tops,
                   wp::array_t<float> down, wp::array_t<int> starts, wp::array_t<float> along,
                   wp::array_t<float> dst) {
#pragma clang fp contract(off)
    enum { N = 16, WIDE = 64, READ = 256, MADE = 256 };
    typedef __typeof__(*src.data) source;
    typedef __typeof__(*dst.data) result;
    typedef source taken __attribute__((vector_size(N * sizeof(source))));
    typedef result given __attribute__((vector_size(N * sizeof(result))));
    typedef float lanes __attribute__((vector_size(N * sizeof(float))));
    typedef int whole __attribute__((vector_size(N * sizeof(int))));
    // Interleaving rows i and i + 8 four times turns 16 x 16 elements.
    const auto turn = [](auto* rows) {
#pragma unroll
        for (int times = 0; times < 4; ++times) {
            __typeof__(*rows) made[N];
#pragma unroll
            for (int i = 0; i < N / 2; ++i) {
                const auto a = rows[i], b = rows[i + N / 2];
                made[2 * i] = __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5,
                                                      21, 6, 22, 7, 23);
                made[2 * i + 1] = __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12,
                                                          28, 13, 29, 14, 30, 15, 31);
            }
#pragma unroll
            for (int i = 0; i < N; ++i) rows[i] = made[i];
        }
    };
    const auto clipped = [](auto v) {
        v = v > 0.0f ? v : 0.0f;
        return (v < 255.0f ? v : 255.0f) + 0.5f;
    };
    const auto stored = [&](lanes v) {
        if (ROUNDED)
            return __builtin_convertvector(__builtin_convertvector(clipped(v), whole), given);
        else
            return __builtin_convertvector(v, given);
    };
    const int height = src.shape[1], inner = src.shape[3], elements = src.shape[2] * inner;
    const int tall = dst.shape[1], m = dst.shape[2];
    const int high_taps = down.shape[1], taps = along.shape[1];
    const int groups = (tall + N - 1) / N, plane = group / groups;
    const int top = (group - plane * groups) * N, rows = tall - top < N ? tall - top : N;
    const source* from[N];
    const float* weights[N];
    result* to[N];
    for (int r = 0; r < N; ++r) {
        const size_t y = r < rows ? top + r : tall - 1;
        from[r] = src.data + ((size_t)plane * height + tops.data[y]) * elements;
        weights[r] = down.data + y * high_taps;
        to[r] = dst.data + ((size_t)plane * tall + y) * m * inner;
    }
    if (inner > MADE || elements < WIDE) {  // many channels, or few pixels: one after the other
        for (int r = 0; r < rows; ++r)
            for (int out = 0; out < m * inner; ++out) {
                const int k = out / inner;
                const source* const p = from[r] + starts.data[k] * inner + out % inner;
                float sum = 0.0f;
                for (int t = 0; t < taps; ++t) {
                    const float w = along.data[(size_t)k * taps + t];
                    float v = 0.0f;
                    for (int s = 0; w != 0.0f && s < high_taps; ++s)
                        if (weights[r][s] != 0.0f)
                            v += weights[r][s] * (float)p[(size_t)s * elements + t * inner];
                    if (w != 0.0f) sum += w * v;
                }
                to[r][out] = (result)(ROUNDED ? (float)(int)clipped(sum) : sum);
            }
        return;
    }
    lanes read[WIDE + READ + WIDE], sums[MADE];
    given made[MADE + N];
    // Weigh the elements from `low` to `high` down the rows; element `low` comes to read[WIDE].
    const auto fetch = [&](int low, int high) {
        for (int e = low; e < high; e += WIDE) {
            const int begin = e + WIDE < elements ? e : elements - WIDE;
            lanes parts[WIDE / N][N];
#pragma clang loop unroll(disable)
            for (int r = 0; r < N; ++r) {
                lanes part[WIDE / N] = {};
                const source* p = from[r] + begin;
#pragma clang loop unroll(disable)
                for (int s = 0; s < high_taps; ++s, p += elements) {
                    const float w = weights[r][s];
                    if (w == 0.0f) continue;
#pragma unroll
                    for (int b = 0; b < WIDE / N; ++b) {
                        taken values;
                        __builtin_memcpy(&values, p + N * b, sizeof values);
                        part[b] += w * __builtin_convertvector(values, lanes);
                    }
                }
#pragma unroll
                for (int b = 0; b < WIDE / N; ++b) parts[b][r] = part[b];
            }
#pragma clang loop unroll(disable)
            for (int b = 0; b < WIDE / N; ++b) {
                turn(parts[b]);
#pragma unroll
                for (int i = 0; i < N; ++i) read[WIDE + begin - low + N * b + i] = parts[b][i];
            }
        }
    };
    for (int k = 0; k < m;) {
        const int low = starts.data[k] * inner;
        int end = k, high = low, count = 0;
        for (; end < m && count + inner <= MADE; ++end, count += inner) {
            const int behind = (starts.data[end] + taps) * inner;
            if (behind - low > READ) break;
            high = behind < elements ? behind : elements;
        }
        if (end == k) {  // a pixel of the result that reads more than there is room for
            const int most = READ / inner;
            for (int i = 0; i < inner; ++i) sums[i] = (lanes){};
            for (int begin = 0; begin < taps; begin += most) {
                const int first = low + begin * inner, last = first + most * inner;
                if (first >= elements) break;
                fetch(first, last < elements ? last : elements);
                for (int t = begin; t < taps && t < begin + most; ++t) {
                    const float w = along.data[(size_t)k * taps + t];
                    if (w == 0.0f) continue;
                    for (int i = 0; i < inner; ++i)
                        sums[i] += w * read[WIDE + (t - begin) * inner + i];
                }
            }
            for (int i = 0; i < inner; ++i) made[i] = stored(sums[i]);
            count = inner;
            ++end;
        } else {
            fetch(low, high);
            for (int x = k, out = 0; x < end; ++x) {
                const float* const w = along.data + (size_t)x * taps;
                const lanes* const p = read + WIDE + starts.data[x] * inner - low;
                for (int i = 0; i < inner; ++i, ++out) {
                    lanes sum = {};
#pragma clang loop unroll(disable)
                    for (int t = 0; t < taps; ++t) {
                        // A weight of 0 is that of what may be infinite, or not there.
                        const lanes weight = (lanes){} + w[t];
                        sum += weight * (weight != 0.0f ? p[t * inner + i] : 0.0f);
                    }
                    made[out] = stored(sum);
                }
            }
        }
        for (int f = 0; f < count; f += N) {
            turn(made + f);
            if (f + N <= count) {
                for (int r = 0; r < rows; ++r)
                    __builtin_memcpy(to[r] + k * inner + f, &made[f + r], sizeof(given));
            } else {
                for (int r = 0; r < rows; ++r)
                    for (int i = f; i < count; ++i) to[r][k * inner + i] = made[f + r][i - f];
            }
        }
        k = end;
    }
}
