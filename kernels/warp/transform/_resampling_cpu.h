// Resizing on the CPU, a row at a time; resampling.py has the equation.

// needs ROUNDED
// Rows `first` to `last` of an image of another size: each is weighed down the rows into a line of
// `room`, and then along the line.
void resample_rows(int slab, int first, int last, wp::array_t<float> src, wp::array_t<int> tops,
                   wp::array_t<float> down, wp::array_t<int> starts, wp::array_t<float> along,
                   wp::array_t<float> room, wp::array_t<float> dst) {
#pragma clang fp contract(off)
    enum { N = 16 };
    typedef __typeof__(*src.data) source;
    typedef __typeof__(*dst.data) result;
    const int inner = src.shape[3], elements = src.shape[2] * inner;
    const int count = dst.shape[2] * inner, high_taps = down.shape[1], taps = along.shape[1];
    const int even = taps + taps % 2;  // a weight that is not there is 0
    float* const sums = room.data + (size_t)slab * room.shape[1];
    float* const shares = sums + count;
    int* const places = (int*)(shares + (size_t)even * count);
    float* __restrict__ const line = (float*)(places + count);
    // Element i of the result takes line[places[i] + t * inner] with the weight shares[t, i].
    for (int k = 0, i = 0; i < count; ++k)
        for (int c = 0; c < inner; ++c, ++i) {
            places[i] = starts.data[k] * inner + c;
            for (int t = 0; t < even; ++t)
                shares[(size_t)t * count + i] = t < taps ? along.data[(size_t)k * taps + t] : 0.0f;
        }
    for (int e = elements; e < elements + even * inner + 4 * N; ++e) line[e] = 0.0f;
    int reach = 0;  // elements of the line that 16 of the result span
    for (int i = 0; i + N <= count; i += N) {
        const int base = starts.data[i / inner], end = starts.data[(i + N - 1) / inner] + 1;
        reach = (end - base) * inner > reach ? (end - base) * inner : reach;
    }
    for (int row = first; row < last; ++row) {
        const int plane = row / dst.shape[1], y = row - plane * dst.shape[1];
        const source* from = src.data + ((size_t)plane * src.shape[1] + tops.data[y]) * elements;
        const float* const weights = down.data + (size_t)y * high_taps;
        result* __restrict__ const made = dst.data + (size_t)row * count;
        // A weight of 0 is that of what may be infinite, or not there.
        bool begun = false;
        for (int s = 0; s < high_taps; ++s, from += elements) {
            const float w = weights[s], v = s + 1 < high_taps ? weights[s + 1] : 0.0f;
            const source* __restrict__ const one = from;
            const source* __restrict__ const two = from + elements;
            if (w == 0.0f) continue;
            if (v != 0.0f) {
                if (begun)
                    for (int e = 0; e < elements; ++e)
                        line[e] = line[e] + w * (float)one[e] + v * (float)two[e];
                else
                    for (int e = 0; e < elements; ++e)
                        line[e] = 0.0f + w * (float)one[e] + v * (float)two[e];
                from += elements;
                ++s;
            } else if (begun) {
                for (int e = 0; e < elements; ++e) line[e] += w * (float)one[e];
            } else {
                for (int e = 0; e < elements; ++e) line[e] = 0.0f + w * (float)one[e];
            }
            begun = true;
        }
        float* __restrict__ const to = ROUNDED ? sums : (float*)made;
        int done = 0;
#if defined(__AVX512F__)
        // One instruction chooses 16 of 32 elements.
        typedef float Sixteen __attribute__((vector_size(64)));
        typedef int Whole __attribute__((vector_size(64)));
        const auto choose = [](const float* p, Whole at) __attribute__((always_inline)) {
            Sixteen low, high;
            __builtin_memcpy(&low, p, sizeof low);
            __builtin_memcpy(&high, p + N, sizeof high);
            return (Sixteen)__builtin_ia32_vpermi2varps512(low, at, high);
        };
        const auto weigh = [&](const bool wide) __attribute__((always_inline)) {
            const int step = N % inner;
            for (int phase = 0; done + N <= count; done += N) {
                Whole at;
                __builtin_memcpy(&at, places + done, sizeof at);
                const int base = places[done] - phase;
                at -= base;
                const float *p = line + base, *share = shares + done;
                Sixteen sum = {};
#pragma clang loop unroll(disable)
                for (int pair = 0; pair < even; pair += 2)
#pragma unroll
                    for (int t = 0; t < 2; ++t, p += inner, share += count) {
                        Sixteen w, v = choose(p, at);
                        if (wide) v = at < 2 * N ? v : choose(p + 2 * N, at);
                        __builtin_memcpy(&w, share, sizeof w);
                        sum += w * (w != 0.0f ? v : 0.0f);
                    }
                __builtin_memcpy(to + done, &sum, sizeof sum);
                phase += step;
                if (phase >= inner) phase -= inner;
            }
        };
        if (reach <= 2 * N)
            weigh(false);
        else if (reach <= 4 * N)
            weigh(true);
#endif
        for (int t = 0; t < taps; t += 2) {
            const float *const w = shares + (size_t)t * count, *const v = w + count;
            const float *const one = line + t * inner, *const two = one + inner;
#pragma clang loop vectorize(assume_safety)
            for (int i = done; i < count; ++i) {
                const float sum = t ? to[i] : 0.0f, a = one[places[i]], b = two[places[i]];
                to[i] = sum + w[i] * (w[i] != 0.0f ? a : 0.0f) + v[i] * (v[i] != 0.0f ? b : 0.0f);
            }
        }
        if (ROUNDED)
            for (int i = 0; i < count; ++i) {
                const float value = to[i] > 0.0f ? to[i] : 0.0f;
                made[i] = (result)(int)((value < 255.0f ? value : 255.0f) + 0.5f);
            }
    }
}
