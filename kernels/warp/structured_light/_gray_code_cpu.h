// Gray codes on the CPU: a row at a time, PART pixels at once, so that loops become vector code.

// needs TYPE, NONE
void decode_row(int row, wp::array_t<TYPE> frames, int begin, int bits, int size, float margin,
                bool joins, wp::array_t<int> codes, wp::array_t<wp::uint8> valid) {
    enum { PART = 256 };
    const int width = codes.shape[1];
    const size_t plane = (size_t)codes.shape[0] * width;
    float least[PART];
    int code[PART], bit[PART];
    for (int left = 0; left < width; left += PART) {
        const int count = width - left < PART ? width - left : PART;
        const TYPE* from = frames.data + begin * plane + (size_t)row * width + left;
        for (int i = 0; i < count; ++i) {
            least[i] = __builtin_inff();
            code[i] = bit[i] = 0;
        }
        for (int k = 0; k < bits; ++k, from += 2 * plane) {
#pragma clang loop vectorize(assume_safety)
            for (int i = 0; i < count; ++i) {
                const float pattern = (float)from[i], inverse = (float)from[plane + i];
                const float apart = __builtin_fabsf(pattern - inverse);
                // A NaN is no code: it makes the least difference NaN, for good.
                least[i] = apart < least[i] || apart != apart ? apart : least[i];
                bit[i] ^= pattern > inverse;
                code[i] = 2 * code[i] + bit[i];
            }
        }
        int* to = codes.data + (size_t)row * width + left;
        unsigned char* good = valid.data + (size_t)row * width + left;
        const unsigned char always = !joins;
#pragma clang loop vectorize(assume_safety)
        for (int i = 0; i < count; ++i) {
            const bool known = (least[i] > margin) & (code[i] < size);
            to[i] = known ? code[i] : NONE;
            good[i] = (good[i] | always) & (unsigned char)known;
        }
    }
}

// needs TYPE
void accept_row(int row, wp::array_t<TYPE> white, wp::array_t<TYPE> black, float contrast,
                wp::array_t<wp::uint8> valid) {
    const int width = valid.shape[1];
    const size_t first = (size_t)row * width;
    const TYPE *bright = white.data + first, *dark = black.data + first;
    unsigned char* to = valid.data + first;
#pragma clang loop vectorize(assume_safety)
    for (int x = 0; x < width; ++x) to[x] &= (float)bright[x] - (float)dark[x] > contrast;
}
