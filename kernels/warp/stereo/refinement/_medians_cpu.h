// The weighted median of each pixel of a row. values[i] and grays[i] point to the rows of the
// window's pixels, at the pixel's own column.
// needs MOST
const auto medians_of_row = [](const float** values, const unsigned char** grays, int radius,
                               int contrast, int columns, float* to) {
    const int size = 2 * radius + 1;
    const auto some = [&](int begin, auto width) __attribute__((always_inline)) {
        enum { LANES = decltype(width)::VALUE };
        typedef typename decltype(width)::Number number;
        typedef float floats __attribute__((vector_size(4 * LANES), aligned(4)));
        typedef int masks __attribute__((vector_size(4 * LANES), aligned(4)));
        typedef number numbers
            __attribute__((vector_size(sizeof(number) * LANES), aligned(sizeof(number))));
        typedef unsigned char bytes __attribute__((vector_size(LANES), aligned(1)));
        // Clang keeps 64 bytes in one register only if a function returns them.
        const auto load = [](const float* p) { return *(const floats*)p; };
        // `sum` of a value is the weight of those before or equal to it. It begins with the weights
        // from its own place on.
        floats v[MOST];
        numbers weight[MOST], sum[MOST], rest = {};
        const numbers center =
            __builtin_convertvector(*(const bytes*)(grays[radius] + begin), numbers);
        for (int i = size - 1; i >= 0; --i) {
            const floats value = load(values[i] + begin);
            const numbers apart =
                __builtin_convertvector(*(const bytes*)(grays[i] + begin), numbers) - center;
            const numbers say = (number)contrast - (apart < 0 ? -apart : apart);
            v[i] = value + 0.0f;  // no -0
            weight[i] = __builtin_convertvector(value == value, numbers) &
                        (say > 1 ? say : 1 + (numbers){});
            rest += weight[i];
            sum[i] = rest;
        }
        // The size is odd: two values at a time are compared with those behind them.
        for (int i = 0; i + 1 < size; i += 2) {
            const floats one = v[i], two = v[i + 1];
            const numbers first = weight[i], second = weight[i + 1];
            const numbers both = __builtin_convertvector(one <= two, numbers);
            numbers total = sum[i] - (both & second), other = sum[i + 1] + (both & first);
#pragma clang loop unroll_count(2)
            for (int j = i + 2; j < size; ++j) {
                const floats value = v[j];
                const numbers here = weight[j];
                const numbers before = __builtin_convertvector(one <= value, numbers);
                const numbers after = __builtin_convertvector(two <= value, numbers);
                total = before ? total - here : total;
                other = after ? other - here : other;
                const numbers own = before ? sum[j] + first : sum[j];
                sum[j] = after ? own + second : own;
            }
            sum[i] = total, sum[i + 1] = other;
        }
        // The least value with enough weight; the others become NaN, which is never less.
        const floats none = __builtin_nanf("") + (floats){};
        floats best = __builtin_inff() + (floats){};
        for (int i = 0; i < size; ++i) {
            const masks few = __builtin_convertvector(2 * sum[i] < rest, masks);
            const floats value = (floats)((masks)v[i] | few);
            best = value < best ? value : best;
        }
        best = __builtin_convertvector(rest == 0, masks) ? none : best;
        *(floats*)(to + begin) = best;
    };
    struct One {
        enum { VALUE = 1 };
        typedef int Number;
    };
    struct Many : One {
        enum { VALUE = 16 };
    };
    struct Small : Many {  // twice the sum of all weights is below 2^15
        typedef short Number;
    };
    const bool small = contrast * 2 * MOST < 1 << 15;
    const auto many = [&](int begin) { small ? some(begin, Small()) : some(begin, Many()); };
    for (int begin = 0; begin + Many::VALUE <= columns; begin += Many::VALUE) many(begin);
    if (columns % Many::VALUE != 0 && columns > Many::VALUE) {
        many(columns - Many::VALUE);  // some for the second time
        return;
    }
    for (int begin = 0; begin < columns % Many::VALUE; ++begin) some(begin, One());
};
