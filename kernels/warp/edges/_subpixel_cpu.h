// List the columns of the edge points of row y, and return their number. The rule is that of
// _parabolas.py. The gradient outside the image is 0, so the outermost pixels are no maximum along
// an axis that leaves the image; there a pixel is compared with itself.
int list_peaks(int y, wp::array_t<float> dy, wp::array_t<float> dx, wp::array_t<wp::uint8> mask,
               int slab, wp::array_t<wp::uint8> flags, wp::array_t<int> columns) {
#pragma clang fp contract(off)
    const int width = mask.shape[1], last = mask.shape[0] - 1, beside = y > 0 && y < last;
    const auto row_of = [&](const auto& array, int row) {
        return (const float*)((const char*)array.data + (size_t)row * array.strides[0]);
    };
    const float *down = row_of(dy, y), *along = row_of(dx, y);
    const float *down_above = row_of(dy, y - beside), *along_above = row_of(dx, y - beside);
    const float *down_below = row_of(dy, y + beside), *along_below = row_of(dx, y + beside);
    const unsigned char* set = mask.data + (size_t)y * width;
    unsigned char* found = flags.data + (size_t)slab * flags.shape[1];
    int *const first = columns.data + (size_t)slab * columns.shape[1], *next = first;
    const auto test = [&](int x, int aside) __attribute__((always_inline)) {
        const auto squared = [](const float* b, const float* a, int i) {
            return a[i] * a[i] + b[i] * b[i];
        };
        const bool steep = __builtin_fabsf(down[x]) > __builtin_fabsf(along[x]);
        const float north = squared(down_above, along_above, x),
                    west = squared(down, along, x - aside);
        const float south = squared(down_below, along_below, x),
                    east = squared(down, along, x + aside);
        const float m = squared(down, along, x), a = steep ? north : west, b = steep ? south : east;
        found[x] =
            (set[x] != 0) & (m > a) & (m >= b) & (a > 0.0f) & (b > 0.0f) & (m < __builtin_inff());
    };
    test(0, 0);
#pragma clang loop vectorize(assume_safety)
    for (int x = 1; x < width - 1; ++x) test(x, 1);
    test(width - 1, 0);
    for (int x = 0; x < width; x += 8) {
        unsigned long long eight = 0;
        __builtin_memcpy(&eight, found + x, width - x < 8 ? width - x : 8);
        for (; eight; eight &= eight - 1) *next++ = x + __builtin_ctzll(eight) / 8;
    }
    return next - first;
}
