#include "_run_cuda.h"

// needs OUT
void sum_along(wp::array_t<KEPT> sums, int radius_x, int top, wp::array_t<OUT> costs) {
    const int width = costs.shape[1], depth = costs.shape[2];
    sum_run(sums.data, sums.shape[1], width, depth, radius_x,
            [&](SUM total, int row, int x, int k) {
                costs.data[((size_t)(top + row) * width + x) * depth + k] = (OUT)total;
            });
}

void correlate_along(wp::array_t<KEPT> sums, Moments of_left, Moments of_right, Windows windows,
                     int top, wp::array_t<float> costs) {
    const int width = costs.shape[1], depth = costs.shape[2], radius_x = windows.radius_x;
    const int channels = of_left.sums.shape[2], wide = sums.shape[1];
    const double n = (double)(2 * windows.radius_y + 1) * (2 * radius_x + 1);
    sum_run(sums.data, wide, width, depth, radius_x, [&](SUM total, int row, int x, int k) {
        const size_t line = (size_t)(top + row) * wide, place = line + x + radius_x;
        const size_t other = line + max(0, min(wide - 1, x + radius_x - windows.first - k));
        double covariance = n * (double)total;
        for (int c = 0; c < channels; ++c)
            covariance -=
                of_left.sums.data[place * channels + c] * of_right.sums.data[other * channels + c];
        const double value =
            1.0 - covariance * of_left.scales.data[place] * of_right.scales.data[other];
        costs.data[((size_t)(top + row) * width + x) * depth + k] = (float)(value < 0.0   ? 0.0
                                                                            : value > 2.0 ? 2.0
                                                                                          : value);
    });
}
