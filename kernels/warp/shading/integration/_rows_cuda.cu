// Poisson's equation along rows on CUDA: a block has a row in shared memory for all stages of both
// transforms. The sums are those of cosines.py, in the same order.
// needs LONGEST, THREADS
void solve_row(wp::array_t<float> one, wp::array_t<float> waves, wp::array_t<float> quarters,
               wp::array_t<float> down, wp::array_t<float> along, wp::array_t<float> two) {
    enum { EACH = LONGEST / THREADS };
    __shared__ float2 row[LONGEST + LONGEST / 16];
    const int height = one.shape[0], width = one.shape[1], thread = threadIdx.x;
    const float2 *wave = (const float2*)waves.data, *quarter = (const float2*)quarters.data;
    // A gap after each 16 numbers: or places 8 apart would be in the same bank.
    const auto at = [](int i) -> float2& { return row[i + i / 16]; };
    const auto plus = [](float2 a, float2 b) { return make_float2(a.x + b.x, a.y + b.y); };
    const auto minus = [](float2 a, float2 b) { return make_float2(a.x - b.x, a.y - b.y); };
    const auto times = [](float2 a, float2 b) {
        return make_float2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
    };
    const auto stage_of_eight = [&](int before, float sign) {
        const float diagonal = 0.70710678118654752f;
        const int eighth = width / 8, m = thread;
        const auto turned = [=](float2 a) { return make_float2(-sign * a.y, sign * a.x); };
        float2 a[8];
        const int k = m % before, step = k * (eighth / before);
        if (m < eighth) {
            a[0] = at(m);
#pragma unroll
            for (int t = 1; t < 8; ++t) {
                const float2 w = wave[t * step];
                a[t] = times(make_float2(w.x, sign * w.y), at(m + t * eighth));
            }
        }
        __syncthreads();
        if (m < eighth) {
            float2 found[2][4];
#pragma unroll
            for (int n = 0; n < 2; ++n) {
                const float2 e = plus(a[n], a[4 + n]), f = minus(a[n], a[4 + n]);
                const float2 g = plus(a[2 + n], a[6 + n]), h = turned(minus(a[2 + n], a[6 + n]));
                found[n][0] = plus(e, g);
                found[n][1] = plus(f, h);
                found[n][2] = minus(e, g);
                found[n][3] = minus(f, h);
            }
            found[1][1] = times(make_float2(diagonal, sign * diagonal), found[1][1]);
            found[1][2] = turned(found[1][2]);
            found[1][3] = times(make_float2(-diagonal, sign * diagonal), found[1][3]);
            const int first = (m - k) * 8 + k;
#pragma unroll
            for (int t = 0; t < 4; ++t) {
                at(first + t * before) = plus(found[0][t], found[1][t]);
                at(first + (4 + t) * before) = minus(found[0][t], found[1][t]);
            }
        }
        __syncthreads();
    };
    const auto stage = [&](int radix, int before, float sign) {
        float2 found[EACH];
#pragma unroll
        for (int j = 0; j < EACH; ++j) {
            const int n = thread + j * THREADS;
            if (n >= width) break;
            const int turn = n % (before * radix);
            const int begin = n / (before * radix) * before + turn % before;
            const int step = turn * (width / (before * radix));
            float2 total = make_float2(0.0f, 0.0f);
            for (int t = 0, place = 0; t < radix; ++t) {
                const float2 w = wave[place];
                total = plus(total,
                             times(make_float2(w.x, sign * w.y), at(begin + t * (width / radix))));
                place += step;
                if (place >= width) place -= width;
            }
            found[j] = total;
        }
        __syncthreads();
#pragma unroll
        for (int j = 0; j < EACH; ++j)
            if (thread + j * THREADS < width) at(thread + j * THREADS) = found[j];
        __syncthreads();
    };
    // The factors that the API takes, in their order.
    const auto transform = [&](float sign) {
        for (int radix = 8, before = 1; before < width;) {
            if (width / before % radix) {
                radix = radix == 2 ? 3 : radix > 2 && radix % 2 == 0 ? radix / 2 : radix + 2;
                continue;
            }
            if (radix == 8)
                stage_of_eight(before, sign);
            else
                stage(radix, before, sign);
            before *= radix;
        }
    };
    const float size = (float)down.shape[0] * (float)width;
    const auto share = [=](float a, float b) {
        return a + b > 0.0f ? 1.0f / (size * (a + b)) : 0.0f;
    };
    for (int line = blockIdx.x; line < height; line += gridDim.x) {
        const float2* from = (const float2*)one.data + (size_t)line * width;
        for (int i = thread; i < width; i += THREADS) at(i) = from[i];
        __syncthreads();
        transform(-1.0f);
        const float upper = down.data[2 * line];
        const float lower = down.data[min(2 * line + 1, down.shape[0] - 1)];
        for (int k = thread; k <= width / 2; k += THREADS) {
            const int other = (width - k) % width;
            const float2 z = at(k), y = at(other), q = quarter[k];
            const float v[4] = {(z.x + y.x) * 0.5f, (z.y - y.y) * 0.5f, (z.y + y.y) * 0.5f,
                                (y.x - z.x) * 0.5f};
            const float near[2] = {share(upper, along.data[k]), share(lower, along.data[k])};
            float a[2] = {(q.x * v[0] + q.y * v[1]) * near[0], (q.x * v[2] + q.y * v[3]) * near[1]};
            float b[2] = {0.0f, 0.0f};
            if (k > 0) {
                b[0] = (q.y * v[0] - q.x * v[1]) * share(upper, along.data[other]);
                b[1] = (q.y * v[2] - q.x * v[3]) * share(lower, along.data[other]);
            }
            const float2 c = make_float2(q.x * a[0] + q.y * b[0], q.y * a[0] - q.x * b[0]);
            const float2 d = make_float2(q.x * a[1] + q.y * b[1], q.y * a[1] - q.x * b[1]);
            at(k) = make_float2(c.x - d.y, c.y + d.x);
            if (other != k) at(other) = make_float2(c.x + d.y, d.x - c.y);
        }
        __syncthreads();
        transform(1.0f);
        float2* to = (float2*)two.data + (size_t)line * width;
        for (int i = thread; i < width; i += THREADS) to[i] = at(i);
        __syncthreads();
    }
}
