// needs SCALAR
// The median of each window of a row, found bit by bit for 64 pixels at once: the value of rank r
// is the largest v with at most r window values below v. A count is at most 15 * 15, so it fits
// into the type of the values.
void median_row(int slab, int plane, int row, int radius, int step, int low, int bits,
                wp::array_t<SCALAR> window, wp::array_t<SCALAR> dst) {
    const int size = 2 * radius + 1, pitch = window.shape[1], columns = dst.shape[2];
    const SCALAR rank = (SCALAR)(size * size / 2);
    const SCALAR* lines = window.data + (size_t)slab * size * pitch;
    SCALAR* out = dst.data + ((size_t)plane * dst.shape[1] + row) * columns;
    for (int begin = 0; begin < columns; begin += 64) {
        const int count = columns - begin < 64 ? columns - begin : 64;
        SCALAR found[64], middle[64], below[64];
        for (int k = 0; k < 64; ++k) found[k] = (SCALAR)low;
        for (int bit = bits - 1; bit >= 0; --bit) {
            const SCALAR half = (SCALAR)(1u << bit);
#pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < 64; ++k) {
                middle[k] = (SCALAR)(found[k] + half);
                below[k] = 0;
            }
            for (int line = 0; line < size; ++line)
                for (int u = 0; u < size; ++u) {
                    const SCALAR* value = lines + (size_t)line * pitch + begin + u * step;
#pragma clang loop vectorize(assume_safety)
                    for (int k = 0; k < 64; ++k) below[k] += value[k] < middle[k];
                }
#pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < 64; ++k) found[k] += half & (SCALAR) - (below[k] <= rank);
        }
        for (int k = 0; k < count; ++k) out[begin + k] = found[k];
    }
}
