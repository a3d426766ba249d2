// needs ROUNDED
// Pixel `k` of line `o`: the weighed sum of pixels of the source, from the start of `k` on. With
// several channels, or along the rows, the elements lie side by side and share the weights.
void resample_element(int o, int k, wp::array_t<float> src, wp::array_t<int> starts,
                      wp::array_t<float> weights, wp::array_t<float> dst) {
    const int n = src.shape[1], inner = src.shape[2], taps = weights.shape[1];
    const float* w = weights.data + (size_t)k * taps;
    const auto* from = src.data + ((size_t)o * n + starts.data[k]) * inner;
    auto* to = dst.data + ((size_t)o * dst.shape[1] + k) * inner;
    enum { PART = 256 };
    float sums[PART];
    for (int begin = 0; begin < inner; begin += PART) {
        const int count = inner - begin < PART ? inner - begin : PART;
        for (int i = 0; i < count; ++i) sums[i] = 0.0f;
        for (int t = 0; t < taps; ++t) {
            if (w[t] == 0.0f) continue;
            const auto* p = from + (size_t)t * inner + begin;
            for (int i = 0; i < count; ++i) sums[i] += w[t] * (float)p[i];
        }
        for (int i = 0; i < count; ++i) {
            float v = sums[i];
            if (ROUNDED) {
                v = v > 0.0f ? v : 0.0f;
                v = (float)(int)((v < 255.0f ? v : 255.0f) + 0.5f);
            }
            to[begin + i] = v;
        }
    }
}

// needs ROUNDED
// All pixels of line `o`, where no or few channels lie side by side.
void resample_line(int o, wp::array_t<float> src, wp::array_t<int> starts,
                   wp::array_t<float> weights, wp::array_t<float> dst) {
    const int n = src.shape[1], inner = src.shape[2], taps = weights.shape[1], m = dst.shape[1];
    const auto* line = src.data + (size_t)o * n * inner;
    auto* to = dst.data + (size_t)o * m * inner;
    for (int k = 0; k < m; ++k) {
        const float* w = weights.data + (size_t)k * taps;
        const auto* from = line + (size_t)starts.data[k] * inner;
        for (int i = 0; i < inner; ++i) {
            float v = 0.0f;
            for (int t = 0; t < taps; ++t)
                if (w[t] != 0.0f) v += w[t] * (float)from[t * inner + i];
            if (ROUNDED) {
                v = v > 0.0f ? v : 0.0f;
                v = (float)(int)((v < 255.0f ? v : 255.0f) + 0.5f);
            }
            to[k * inner + i] = v;
        }
    }
}
