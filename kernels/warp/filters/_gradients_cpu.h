#include "../_angles.h"

// Write the lengths and the angles of the derivatives of a row. A minimum or a maximum of a number
// and NaN is the number, as in _angles.py.
void polar_row(wp::array_t<Wide> dy, wp::array_t<Wide> dx, int row, int size,
               wp::array_t<Wide> magnitude, wp::array_t<Wide> orientation) {
#pragma clang fp contract(off)
    const auto row_of = [row](const auto& wide) {
        return (float*)((char*)wide.data + (size_t)row * wide.strides[1]);
    };
    const float *down = row_of(dy), *along = row_of(dx);
    float *length = row_of(magnitude), *turned = row_of(orientation);
#pragma clang loop vectorize(assume_safety) vectorize_width(16)
    for (int i = 0; i < size; ++i) {
        const float y = down[i], x = along[i];
        const float ay = __builtin_fabsf(y), ax = __builtin_fabsf(x);
        length[i] = wp::sqrt(x * x + y * y);
        turned[i] = Alike::angle(y, x, ay > ax, wp::min(ax, ay), wp::max(ax, ay));
    }
}
