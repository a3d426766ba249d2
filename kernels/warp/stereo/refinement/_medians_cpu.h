// The weighted median of each pixel of a row. values[i] and grays[i] point to the rows of the
// window's pixels, at the pixel's own column.
// needs MOST
const auto medians_of_row = [](const float** values, const unsigned char** grays, int radius,
                               int contrast, int columns, float* to) {
    const int size = 2 * radius + 1;
    const auto some = [&](int begin, auto width) {
        enum { LANES = decltype(width)::VALUE };
        float v[MOST][LANES], best[LANES];
        int weight[MOST][LANES], sum[MOST][LANES], total[LANES];
        for (int k = 0; k < LANES; ++k) total[k] = 0;
        for (int i = 0; i < size; ++i) {
            const float* value = values[i] + begin;
            const unsigned char* near = grays[i] + begin;
            const unsigned char* center = grays[radius] + begin;
#pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < LANES; ++k) {
                const int unlike = near[k] < center[k] ? center[k] - near[k] : near[k] - center[k];
                const int say = contrast - unlike > 1 ? contrast - unlike : 1;
                v[i][k] = value[k] + 0.0f;
                weight[i][k] = sum[i][k] = value[k] == value[k] ? say : 0;
                total[k] += weight[i][k];
            }
        }
        for (int i = 0; i < size; ++i)
            for (int j = i + 1; j < size; ++j) {
#pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < LANES; ++k) {
                    const bool before = v[i][k] <= v[j][k];
                    sum[j][k] += before ? weight[i][k] : 0;
                    sum[i][k] += before ? 0 : weight[j][k];
                }
            }
        for (int k = 0; k < LANES; ++k) best[k] = __builtin_nanf("");
        for (int i = 0; i < size; ++i) {
#pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < LANES; ++k) {
                const bool enough = weight[i][k] > 0 && 2 * sum[i][k] >= total[k];
                best[k] = enough && !(best[k] <= v[i][k]) ? v[i][k] : best[k];
            }
        }
        for (int k = 0; k < LANES; ++k) to[begin + k] = best[k];
    };
    struct Many {
        enum { VALUE = 16 };
    };
    struct One {
        enum { VALUE = 1 };
    };
    int begin = 0;
    for (; begin + Many::VALUE <= columns; begin += Many::VALUE) some(begin, Many());
    for (; begin < columns; ++begin) some(begin, One());
};
