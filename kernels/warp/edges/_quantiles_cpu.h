// needs BINS
// Count the digits of the gradients' lengths in the rows of a slab. Only a length whose upper bits
// are those found so far counts; below the first digit, few vectors have one. Successive lengths
// are counted in different tables, as they often have the same digit.
void count_rows(int slab, int first, int last, wp::array_t<float> dy, wp::array_t<float> dx,
                int norm, int level, int shift, int width, wp::array_t<int> found,
                wp::array_t<int> counts, wp::array_t<int> most) {
#pragma clang fp contract(off)
    const int columns = dy.shape[1], mask = (1 << width) - 1, rest = shift + width;
    const int one = found.data[0], two = found.data[2];
    int *ones = counts.data + (size_t)slab * 2 * BINS, *twos = ones + BINS, largest = 0;
    int tables[4][BINS];
    for (int k = 0; k < BINS; ++k) {
        ones[k] = twos[k] = 0;
        for (int t = 0; t < 4; ++t) tables[t][k] = 0;
    }
    const auto count = [&](const float* down, const float* along,
                           int size) __attribute__((always_inline)) {
        int bits[64], some = 0;
#pragma clang loop vectorize(assume_safety)
        for (int i = 0; i < size; ++i) {
            const float ax = __builtin_fabsf(along[i]), ay = __builtin_fabsf(down[i]);
            const float m = norm == 0 ? ax + ay : along[i] * along[i] + down[i] * down[i];
            int pattern;
            __builtin_memcpy(&pattern, &m, 4);
            bits[i] = m > 0.0f ? pattern : 0;  // NaN counts as 0
            largest = bits[i] > largest ? bits[i] : largest;
            some |= ((bits[i] >> rest) == one) | ((bits[i] >> rest) == two);
        }
        if (level == 0) {
            for (int i = 0; i < size; ++i) ++tables[i & 3][bits[i] >> shift & mask];
        } else if (some) {
            for (int i = 0; i < size; ++i) {
                const int digit = bits[i] >> shift & mask;
                ones[digit] += (bits[i] >> rest) == one;
                twos[digit] += (bits[i] >> rest) == two;
            }
        }
    };
    for (int y = first; y < last; ++y) {
        const float* down = (const float*)((const char*)dy.data + (size_t)y * dy.strides[0]);
        const float* along = (const float*)((const char*)dx.data + (size_t)y * dx.strides[0]);
        int x = 0;
        for (; x + 64 <= columns; x += 64) count(down + x, along + x, 64);
        count(down + x, along + x, columns - x);
    }
    if (level == 0)
        for (int k = 0; k < BINS; ++k)
            ones[k] = (tables[0][k] + tables[1][k]) + (tables[2][k] + tables[3][k]);
    most.data[slab] = largest;
}
