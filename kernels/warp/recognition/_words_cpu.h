// needs LANES
// Lay 16 words side by side: 4 bytes of the first, of the second, ...; and 128 times their sums.
void pack_group(int group, wp::array_t<wp::int8> words, wp::array_t<wp::int8> packed,
                wp::array_t<int> sums) {
    const int size = words.shape[1], count = words.shape[0];
    wp::int8* out = packed.data + (size_t)group * size * LANES;
    for (int j = 0; j < LANES; ++j) {
        const int word = group * LANES + j;
        int sum = 0;
        for (int k = 0; k < size; ++k) {
            const wp::int8 value = word < count ? words.data[(size_t)word * size + k] : 0;
            out[(k / 4 * LANES + j) * 4 + k % 4] = value;
            sum += value;
        }
        // Places without a word get the smallest product.
        sums.data[group * LANES + j] = word < count ? 128 * sum : 1 << 30;
    }
}

// needs LANES, MOST, LARGEST
// The best words of the patches of a slab, eight at a time.
void match_rows(int first, int last, wp::array_t<wp::int8> patches, wp::array_t<wp::int8> packed,
                wp::array_t<int> sums, int least, wp::array_t<int> products,
                wp::array_t<int> matches) {
    enum { ROWS = 8 };
    typedef int lanes __attribute__((vector_size(4 * LANES)));
    const int size = patches.shape[1], most = matches.shape[1], groups = packed.shape[0];
    wp::uint8 own[ROWS][LARGEST];
    for (int row = first; row < last; row += ROWS) {
        int floors[ROWS], found[ROWS], best[ROWS][MOST], where[ROWS][MOST];
        for (int r = 0; r < ROWS; ++r) {
            const int at = row + r < last ? row + r : last - 1;
            // The dot product of bytes takes unsigned with signed ones: 128 is added to the first.
            for (int k = 0; k < size; ++k) own[r][k] = patches.data[(size_t)at * size + k] ^ 128;
            floors[r] = least - 1;
            found[r] = 0;
        }
        for (int g = 0; g < groups; ++g) {
            const wp::int8* p = packed.data + (size_t)g * size * LANES;
            lanes dots[ROWS];
            for (int r = 0; r < ROWS; ++r) dots[r] = (lanes){};
            for (int k = 0; k < size; k += 4) {
#if defined(__AVX512VNNI__)
                const lanes other = *(const lanes*)(p + (size_t)k * LANES);
#pragma unroll
                for (int r = 0; r < ROWS; ++r) {
                    int four;
                    __builtin_memcpy(&four, own[r] + k, 4);
                    dots[r] = (lanes)__builtin_ia32_vpdpbusd512(
                        (__attribute__((vector_size(64))) int)dots[r], (lanes){} + four, other);
                }
#else
                const wp::int8* other = p + (size_t)k * LANES;
                for (int r = 0; r < ROWS; ++r)
                    for (int j = 0; j < LANES; ++j)
                        dots[r][j] += own[r][k] * other[4 * j] + own[r][k + 1] * other[4 * j + 1] +
                                      own[r][k + 2] * other[4 * j + 2] +
                                      own[r][k + 3] * other[4 * j + 3];
#endif
            }
            const lanes offset = *(const lanes*)(sums.data + (size_t)g * LANES);
            for (int r = 0; r < ROWS; ++r) {
                const lanes dot = dots[r] - offset;
                if (__builtin_reduce_max(dot) <= floors[r]) continue;
                for (int j = 0; j < LANES; ++j) {
                    if (dot[j] <= floors[r]) continue;
                    int at = found[r] < most ? found[r]++ : most - 1;
                    for (; at > 0 && best[r][at - 1] < dot[j]; --at) {
                        best[r][at] = best[r][at - 1];
                        where[r][at] = where[r][at - 1];
                    }
                    best[r][at] = dot[j];
                    where[r][at] = g * LANES + j;
                    if (found[r] == most) floors[r] = best[r][most - 1];
                }
            }
        }
        for (int r = 0; r < ROWS && row + r < last; ++r)
            for (int m = 0; m < most; ++m) {
                const size_t out = (size_t)(row + r) * most + m;
                products.data[out] = m < found[r] ? best[r][m] : 0;
                matches.data[out] = m < found[r] ? where[r][m] : -1;
            }
    }
}
