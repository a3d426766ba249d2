// Add the squares of gradients to parts `first` to `last`, each of 16 sums.
void add_parts(int first, int last, wp::array_t<float> gradients, wp::array_t<float> parts) {
    const long long count = gradients.shape[0], all = parts.shape[0];
    for (int part = first; part < last; ++part) {
        const long long begin = count * part / all, end = count * (part + 1) / all;
        float lanes[16] = {};
        long long i = begin;
        for (; i + 16 <= end; i += 16) {
            const float* g = gradients.data + i;
#pragma clang loop vectorize(assume_safety)
            for (int lane = 0; lane < 16; ++lane) lanes[lane] += g[lane] * g[lane];
        }
        float sum = 0.0f;
        for (; i < end; ++i) sum += gradients.data[i] * gradients.data[i];
        for (int lane = 0; lane < 16; ++lane) sum += lanes[lane];
        parts.data[part] += sum;
    }
}
