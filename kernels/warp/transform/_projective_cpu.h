// needs ROUNDED, CHANNELS, TWO
// A row of an image seen through a homography, linearly: `inverse` takes (x, y, 1) of the result to
// the image. Returns how many pixels it lists in `left`, for others to find: those on the last row
// or column, and, unless all beyond the image is `cval`, those beyond.
int warp_row(int row, int slab, wp::array_t<float> src, wp::array_t<double> inverse, int constant,
             float cval, wp::array_t<int> left, wp::array_t<float> dst) {
#pragma clang fp contract(off)
    enum { N = 16, C = CHANNELS };
    typedef __typeof__(*src.data) source;
    typedef __typeof__(*dst.data) result;
    typedef source taken __attribute__((vector_size(2 * N * sizeof(source))));
    typedef source taken4 __attribute__((vector_size(4 * sizeof(source))));
    typedef result given __attribute__((vector_size(N * sizeof(result))));
    typedef result given4 __attribute__((vector_size(4 * sizeof(result))));
    typedef float lanes __attribute__((vector_size(N * sizeof(float))));
    typedef float lanes4 __attribute__((vector_size(4 * sizeof(float))));
    typedef int whole __attribute__((vector_size(N * sizeof(int))));
    typedef int whole4 __attribute__((vector_size(4 * sizeof(int))));
    const auto clipped = [](auto v) {
        v = v > 0.0f ? v : 0.0f;
        return (v < 255.0f ? v : 255.0f) + 0.5f;
    };
    const int planes = dst.shape[0], tall = dst.shape[1], wide = dst.shape[2];
    const int height = src.shape[1], width = src.shape[2], pitch = width * C;
    const double* const m = inverse.data;
    const double last_x = width - 1, last_y = height - 1, v = row;
    const bool affine = m[6] == 0.0 && m[7] == 0.0 && m[8] == 1.0;
    const result outside = (result)(ROUNDED ? (float)(int)clipped((lanes4){} + cval)[0] : cval);
    int* const list = left.data + (size_t)slab * wide;
    int listed = 0;
    for (int begin = 0; begin < wide; begin += N) {
        double xs[N], ys[N];
        int at[N], state[N];
        float fx[N], fy[N];
        if (affine) {  // to divide by 1 changes nothing
            for (int k = 0; k < N; ++k) {
                const double u = begin + k;
                xs[k] = m[0] * u + m[1] * v + m[2];
                ys[k] = m[3] * u + m[4] * v + m[5];
            }
        } else {
            for (int k = 0; k < N; ++k) {
                const double u = begin + k;
                const double w = m[6] * u + m[7] * v + m[8];
                xs[k] = (m[0] * u + m[1] * v + m[2]) / w;
                ys[k] = (m[3] * u + m[4] * v + m[5]) / w;
            }
        }
        int there = 0, other = 0;
#pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < N; ++k) {
            const double x = xs[k], y = ys[k];
            const int inside = (x >= 0.0) & (x < last_x) & (y >= 0.0) & (y < last_y);
            // In the last corner, more than a pixel of the image would be read.
            const int corner = (x >= last_x - 1.0) & (y >= last_y - 1.0);
            const int within = (x >= 0.0) & (x <= last_x) & (y >= 0.0) & (y <= last_y);
            const int good = inside & (C == 1 || !corner);
            const int i = good ? (int)y : 0, j = good ? (int)x : 0;
            fx[k] = (float)(x - (double)j);
            fy[k] = (float)(y - (double)i);
            at[k] = i * pitch + j * C;
            state[k] = good ? 0 : (constant & !within) ? 1 : 2;
            there |= good;
            other |= state[k];
        }
        const int count = wide - begin < N ? wide - begin : N;
        if (other)
            for (int k = 0; k < count; ++k)
                if (state[k] == 2) list[listed++] = begin + k;
        for (int p = 0; p < planes; ++p) {
            const source* const from = src.data + (size_t)p * height * pitch;
            result* const to = dst.data + (((size_t)p * tall + row) * wide + begin) * C;
            result found[N * C + 4];
            if (there && C == 1) {
                // Two pixels are copied as one number. The compiler must not see that they become
                // a vector: it would insert one after the other into it, each behind the last.
                source pairs[2][2 * N];
#pragma unroll
                for (int k = 0; k < N; ++k) {
                    TWO top, low;
                    __builtin_memcpy(&top, from + at[k], sizeof top);
                    __builtin_memcpy(&low, from + at[k] + pitch, sizeof low);
                    asm("" : "+r"(top), "+r"(low));
                    __builtin_memcpy(&pairs[0][2 * k], &top, sizeof top);
                    __builtin_memcpy(&pairs[1][2 * k], &low, sizeof low);
                }
                lanes x, y, lines[2];
                __builtin_memcpy(&x, fx, sizeof x);
                __builtin_memcpy(&y, fy, sizeof y);
#pragma unroll
                for (int i = 0; i < 2; ++i) {
                    taken both;
                    __builtin_memcpy(&both, pairs[i], sizeof both);
                    const auto a = __builtin_shufflevector(both, both, 0, 2, 4, 6, 8, 10, 12, 14,
                                                           16, 18, 20, 22, 24, 26, 28, 30);
                    const auto b = __builtin_shufflevector(both, both, 1, 3, 5, 7, 9, 11, 13, 15,
                                                           17, 19, 21, 23, 25, 27, 29, 31);
                    lines[i] = (1.0f - x) * __builtin_convertvector(a, lanes) +
                               x * __builtin_convertvector(b, lanes);
                }
                const lanes sum = (1.0f - y) * lines[0] + y * lines[1];
                given made;
                if (ROUNDED)
                    made = __builtin_convertvector(__builtin_convertvector(clipped(sum), whole),
                                                   given);
                else
                    made = __builtin_convertvector(sum, given);
                __builtin_memcpy(found, &made, sizeof made);
            } else if (there) {
#pragma clang loop unroll_count(4)
                for (int k = 0; k < N; ++k) {
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
            if (other)
                for (int k = 0; k < count; ++k)
                    if (state[k] == 1)
                        for (int c = 0; c < C; ++c) found[k * C + c] = outside;
            if (count == N)
                __builtin_memcpy(to, found, N * C * sizeof(result));
            else
                for (int i = 0; i < count * C; ++i) to[i] = found[i];
        }
    }
    return listed;
}
