#include "_sums_cpu.h"

// `moments` holds the sums and scales of windows of the right image in the order of a pixel's
// disparities, as the lines of the row do; each place is the middle of a window.
void correlation(int slab, int first, int last, wp::array_t<ELEMENT> left,
                 wp::array_t<ELEMENT> right, Windows windows, Moments of_left, Moments of_right,
                 wp::array_t<PIXEL> lines, wp::array_t<SUM> columns, wp::array_t<double> moments,
                 wp::array_t<float> costs) {
    typedef double reals
        __attribute__((vector_size(LANES * sizeof(double)), aligned(8), may_alias));
    typedef float outs __attribute__((vector_size(LANES * sizeof(float)), aligned(4), may_alias));
    const int width = left.shape[1], count = costs.shape[2], channels = left.shape[2];
    const int radius_x = windows.radius_x;
    const WindowRow row = {left.data,
                           right.data,
                           left.shape[0],
                           width,
                           channels,
                           1,
                           windows.first,
                           count,
                           windows.radius_y,
                           radius_x,
                           lines.data + (size_t)slab * lines.shape[1],
                           columns.data + (size_t)slab * columns.shape[1]};
    const double n = (double)(2 * windows.radius_y + 1) * (2 * radius_x + 1);
    const int wide = row.wide(), pitch = width + row.range();
    double* const right_scale = moments.data + (size_t)slab * moments.shape[1];
    double* const right_sum = right_scale + pitch;
    for (int y = first; y < last; ++y) {
        const double* const sums = of_left.sums.data + (size_t)y * wide * channels;
        const double* const scales = of_left.scales.data + (size_t)y * wide;
        for (int i = 0; i < pitch; ++i) {
            int at = width - 1 - windows.first - i + radius_x;
            at = at < 0 ? 0 : at < wide ? at : wide - 1;
            right_scale[i] = of_right.scales.data[(size_t)y * wide + at];
            for (int c = 0; c < channels; ++c)
                right_sum[(size_t)c * pitch + i] =
                    of_right.sums.data[((size_t)y * wide + at) * channels + c];
        }
        sum_windows(
            row, y, y == first,
            [&](const WindowRow::sums& total, int x, int chunk) __attribute__((always_inline)) {
                const int place = x - radius_x, at = width - 1 - (x - 2 * radius_x) + chunk;
                reals covariance = n * __builtin_convertvector(total, reals);
                for (int c = 0; c < channels; ++c)
                    covariance -= sums[place * channels + c] *
                                  *(const reals*)(right_sum + (size_t)c * pitch + at);
                reals value = 1.0 - covariance * scales[place] * *(const reals*)(right_scale + at);
                value = value < 0.0 ? (reals){} : value;
                value = value > 2.0 ? 2.0 - (reals){} : value;
                const outs rounded = __builtin_convertvector(value, outs);
                float* const to =
                    costs.data + ((size_t)y * width + x - 2 * radius_x) * count + chunk;
                if (chunk + LANES <= count)
                    *(outs*)to = rounded;
                else
                    for (int k = 0; chunk + k < count; ++k) to[k] = rounded[k];
            });
    }
}
