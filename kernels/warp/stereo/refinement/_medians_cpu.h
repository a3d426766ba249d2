// The weighted median of each pixel of a row. values[i] and grays[i] point to the rows of the
// window's pixels, at the pixel's own column.
// needs MOST
const auto medians_of_row = [](const float** values, const unsigned char** grays, int radius,
                               int contrast, int columns, float* to) {
    const int size = 2 * radius + 1;
    const auto some = [&](int begin, auto width) __attribute__((always_inline)) {
        enum { LANES = decltype(width)::VALUE };
        typedef float floats __attribute__((vector_size(4 * LANES), aligned(4)));
        typedef int numbers __attribute__((vector_size(4 * LANES), aligned(4)));
        typedef unsigned char bytes __attribute__((vector_size(LANES), aligned(1)));
        // `sum` of a value is the weight of those before or equal to it. It begins with the weights
        // from its own place on.
        floats v[MOST];
        numbers weight[MOST], sum[MOST], rest = {};
        const numbers center =
            __builtin_convertvector(*(const bytes*)(grays[radius] + begin), numbers);
        for (int i = size - 1; i >= 0; --i) {
            const floats value = *(const floats*)(values[i] + begin);
            const numbers apart =
                __builtin_convertvector(*(const bytes*)(grays[i] + begin), numbers) - center;
            const numbers say = contrast - (apart < 0 ? -apart : apart);
            v[i] = value + 0.0f;  // no -0
            weight[i] = (value == value) & (say > 1 ? say : 1 + (numbers){});
            rest += weight[i];
            sum[i] = rest;
        }
        for (int i = 0; i < size; ++i) {
            const floats one = v[i];
            const numbers say = weight[i];
            numbers total = sum[i];
#pragma clang loop unroll_count(4)
            for (int j = i + 1; j < size; ++j) {
                const numbers before = one <= v[j];
                total -= before & weight[j];
                sum[j] += before & say;
            }
            sum[i] = total;
        }
        floats best = __builtin_nanf("") + (floats){};
        for (int i = 0; i < size; ++i) {
            const numbers enough = (weight[i] > 0) & (2 * sum[i] >= rest);
            const numbers less = ~(best <= v[i]);
            best = (enough & less) != 0 ? v[i] : best;
        }
        *(floats*)(to + begin) = best;
    };
    struct Many {
        enum { VALUE = 16 };
    };
    struct One {
        enum { VALUE = 1 };
    };
    for (int begin = 0; begin + Many::VALUE <= columns; begin += Many::VALUE) some(begin, Many());
    if (columns % Many::VALUE != 0 && columns > Many::VALUE) {
        some(columns - Many::VALUE, Many());  // some for the second time
        return;
    }
    for (int begin = 0; begin < columns % Many::VALUE; ++begin) some(begin, One());
};
