#include "../_angles.h"

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

// needs LOG_1 LOG_2 LOG_3 LOG_4 LN2 LEAST_MANTISSA MANTISSA_BITS LEAST_RATIO
// Locate the edges of row y in `count` listed columns, as _parabolas.py does, from place `begin` on.
void locate_row(int y, wp::array_t<float> dy, wp::array_t<float> dx, int slab,
                wp::array_t<int> columns, int count, int begin, wp::array_t<float> points,
                wp::array_t<float> orientation, wp::array_t<float> strength) {
#pragma clang fp contract(off)
    const int* column = columns.data + (size_t)slab * columns.shape[1];
    const long long pitch = dy.strides[0] / 4;
    const float *down = dy.data + y * pitch, *along = dx.data + y * pitch;
    const auto log_of_ratio = [](float a, float b) __attribute__((always_inline)) {
        const float ratio = a / b > (float)LEAST_RATIO ? a / b : (float)LEAST_RATIO;
        int bits;
        __builtin_memcpy(&bits, &ratio, 4);
        const int exponent = (bits - LEAST_MANTISSA) >> MANTISSA_BITS;
        bits -= exponent << MANTISSA_BITS;
        float m;
        __builtin_memcpy(&m, &bits, 4);
        const float s = (m - 1.0f) / (m + 1.0f), z = s * s;
        const float tail = ((float)LOG_4 * z + (float)LOG_3) * z + (float)LOG_2;
        return 2.0f * s * ((tail * z + (float)LOG_1) * z + 1.0f) + (float)exponent * (float)LN2;
    };
#pragma clang loop vectorize(assume_safety)
    for (int k = 0; k < count; ++k) {
        const auto squared = [&](long long i) { return along[i] * along[i] + down[i] * down[i]; };
        const long long x = column[k];
        const float v = down[x], u = along[x];
        const bool steep = __builtin_fabsf(v) > __builtin_fabsf(u);
        const long long step = steep ? pitch : 1;
        const float m = squared(x);
        const float p = log_of_ratio(squared(x - step), m), q = log_of_ratio(squared(x + step), m);
        const float offset = 0.5f * (p - q) / (p + q), share = steep ? 1.0f : 0.0f;
        points.data[2 * (begin + k)] = (float)y + share * offset;
        points.data[2 * (begin + k) + 1] = (float)(int)x + (1.0f - share) * offset;
        orientation.data[begin + k] = Alike::angle(v, u);
        strength.data[begin + k] = __builtin_sqrtf(m);
    }
}
