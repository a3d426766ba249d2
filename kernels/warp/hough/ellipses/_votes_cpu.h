#include "_third_point.h"

// The rows of a slab are first points; each makes a pair with every point before it. The bins of 64
// third points are computed as vector code; points that do not vote share the last bin.
void vote_pairs(int slab, int first, int last, wp::array_t<float> points, Bounds bounds,
                wp::array_t<int> histograms, wp::array_t<int> votes, wp::array_t<int> axes) {
#pragma clang fp contract(off)
    const int count = points.shape[1], bins = histograms.shape[1] - 1;
    const float *row = points.data, *column = row + count;
    const float *down = column + count, *along = down + count;
    const float narrow = bounds.narrow, wide = bounds.wide, turn = bounds.turn;
    const float per_bin = bounds.per_bin;
    const bool directed = turn >= 0.0f;
    int* histogram = histograms.data + (size_t)slab * (bins + 1);
    for (int i = first; i < last; ++i)
        for (int j = 0; j < count; ++j) {
            int best = 0, at = 0;
            const Axis axis(row, column, i, j);
            const float whole = axis.whole;
            bool paired = (j < i) & (whole >= bounds.least) & (whole <= bounds.most);
            if (directed & paired)
                paired = Axis::aligned(down[i], along[i], axis.ey, axis.ex, whole, turn) &
                         Axis::aligned(down[j], along[j], axis.ey, axis.ex, whole, turn);
            if (paired) {
                for (int b = 0; b <= bins; ++b) histogram[b] = 0;
                for (int begin = 0; begin < count; begin += 64) {
                    const int n = count - begin < 64 ? count - begin : 64;
                    int bin[64];
#pragma clang loop vectorize(assume_safety)
                    for (int k = 0; k < n; ++k) {
                        const float square =
                            axis.minor(row[begin + k], column[begin + k], down[begin + k],
                                       along[begin + k], narrow, wide, directed, turn);
                        const float length = wp::sqrt(square >= 0.0f ? square : 0.0f);
                        bin[k] = square >= 0.0f ? (int)(length * per_bin + 0.5f) : bins;
                    }
                    for (int k = 0; k < n; ++k) ++histogram[bin[k]];
                }
                for (int b = 0; b < bins; ++b)
                    if (histogram[b] > best) best = histogram[b], at = b;
            }
            votes.data[(size_t)i * count + j] = best;
            axes.data[(size_t)i * count + j] = at;
        }
}
