#include "_medians_network.h"

// needs SCALAR
// The median of each window of a row. The lines behind those of the window are scratch.
void median_row(int slab, int plane, int row, int radius, int step, int low, int bits,
                wp::array_t<SCALAR> window, wp::array_t<SCALAR> dst) {
    const int size = 2 * radius + 1, pitch = window.shape[1], columns = dst.shape[2];
    const SCALAR* lines = window.data + (size_t)slab * 2 * size * pitch;
    SCALAR* sorted = window.data + ((size_t)slab * 2 + 1) * size * pitch;
    SCALAR* out = dst.data + ((size_t)plane * dst.shape[1] + row) * columns;
    struct Three {
        enum { side = 3 };
    };
    struct Five {
        enum { side = 5 };
    };
    const auto exchange = [&](auto window) {
        constexpr int side = decltype(window)::side, LANES = sizeof(PIXEL) / sizeof(SCALAR);
        for (int x = 0; x < columns + (side - 1) * step; x += LANES) {
            PIXEL v[side];
#pragma clang loop unroll(full)
            for (int i = 0; i < side; ++i)
                __builtin_memcpy(v + i, lines + i * pitch + x, sizeof(PIXEL));
            Network::sort(v);
#pragma clang loop unroll(full)
            for (int i = 0; i < side; ++i)
                __builtin_memcpy(sorted + i * pitch + x, v + i, sizeof(PIXEL));
        }
        for (int x = 0; x < columns; x += LANES) {
            PIXEL v[side * side];
#pragma clang loop unroll(full)
            for (int i = 0; i < side * side; ++i)
                __builtin_memcpy(v + i, sorted + i / side * pitch + x + i % side * step,
                                 sizeof(PIXEL));
            const PIXEL middle = Network::median(v);
            const int count = columns - x < LANES ? columns - x : LANES;
            if (count == LANES)
                __builtin_memcpy(out + x, &middle, sizeof(PIXEL));
            else
                __builtin_memcpy(out + x, &middle, count * sizeof(SCALAR));
        }
    };
    if (radius == 1) return exchange(Three());
    if (radius == 2) return exchange(Five());
    // Find the value bit by bit for 64 pixels at once: the value of rank r is the largest v with at
    // most r window values below v. A count is at most 31 * 31, and for bytes 15 * 15, so it fits
    // into the type of the values.
    const SCALAR rank = (SCALAR)(size * size / 2);
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
