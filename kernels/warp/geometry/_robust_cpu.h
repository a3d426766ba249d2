#include "_robust.h"

// needs GROUP, PREVIEW, COST_ONE, NO_COST, FLAT
// Of the hypotheses of a group the one with the least preview, by cost and then by number.
void best_of_group(int kind, int seed, int first, wp::array_t<float> matches, int start, int count,
                   float square, int at, wp::array_t<float> models, wp::array_t<int> costs) {
    const size_t pitch = matches.shape[1];
    const float *x = matches.data + start, *y = x + pitch, *u = y + pitch, *v = u + pitch;
    const float scale = COST_ONE / square;
    const int previewed = count < PREVIEW ? count : PREVIEW;
    float best[9];
    int least = NO_COST;
    for (int n = 0; n < GROUP; ++n) {
        double model[9];
        if (!Robust::solve(kind, x, pitch, count, seed, first + n, FLAT, model)) continue;
        float h[9];
        for (int i = 0; i < 9; ++i) h[i] = (float)model[i];
        int cost = 0;
#pragma clang loop vectorize(assume_safety)
        for (int i = 0; i < previewed; ++i) {
            const float r = Robust::transfer(h, x[i], y[i], u[i], v[i]);
            cost += r < square ? (int)(r * scale + 0.5f) : COST_ONE;
        }
        if (cost < least) {
            least = cost;
            for (int i = 0; i < 9; ++i) best[i] = h[i];
        }
    }
    for (int i = 0; i < 9; ++i) models.data[9 * (size_t)at + i] = least < NO_COST ? best[i] : 0.0f;
    int cost = 0;
    if (least < NO_COST) {
#pragma clang loop vectorize(assume_safety)
        for (int i = 0; i < count; ++i) {
            const float r = Robust::transfer(best, x[i], y[i], u[i], v[i]);
            cost += r < square ? (int)(r * scale + 0.5f) : COST_ONE;
        }
    }
    costs.data[at] = least < NO_COST ? cost : NO_COST;
}

// needs LANES, SUMS, COST_ONE
// Steps of least squares from a model, each over the matches below a limit of its own. The result
// stays unless it costs more than before by over a sixteenth.
void improve(int kind, wp::array_t<float> matches, int start, int count, float square,
             wp::array_t<float> schedule, int at, wp::array_t<double> models,
             wp::array_t<int> costs, wp::array_t<int> supports) {
    const size_t pitch = matches.shape[1];
    const float *x = matches.data + start, *y = x + pitch, *u = y + pitch, *v = u + pitch;
    const float scale = COST_ONE / square;
    double* model = models.data + 9 * (size_t)at;
    double h[9];
    for (int i = 0; i < 9; ++i) h[i] = model[i];
    for (int round = 0; round < 2; ++round) {
        bool fixed = true;
        for (int s = 0; s < schedule.shape[0] && fixed && round; ++s) {
            const double limit = (double)square * (double)schedule.data[s];
            double sums[SUMS * LANES];
            for (int i = 0; i < SUMS * LANES; ++i) sums[i] = 0.0;
            for (int base = 0; base < count; base += LANES) {
                // Robust::add, a step at a time for all lanes: that becomes vector code.
                double a[LANES], b[LANES], c[LANES], p[LANES], q[LANES], ex[LANES], ey[LANES];
                double square[LANES], along[LANES], product[LANES];
#pragma clang loop vectorize(assume_safety)
                for (int l = 0; l < LANES; ++l) {
                    const int i = base + l;
                    const double inverse = 1.0 / ((h[6] * x[i] + h[7] * y[i]) + h[8]);
                    const double px = ((h[0] * x[i] + h[1] * y[i]) + h[2]) * inverse;
                    const double py = ((h[3] * x[i] + h[4] * y[i]) + h[5]) * inverse;
                    const double rx = px - u[i], ry = py - v[i];
                    const bool counts = (i < count) & (rx * rx + ry * ry < limit);
                    p[l] = counts ? px : 0.0, q[l] = counts ? py : 0.0;
                    ex[l] = counts ? rx : 0.0, ey[l] = counts ? ry : 0.0;
                    c[l] = counts ? inverse : 0.0;
                }
                for (int l = 0; l < LANES; ++l) {
                    a[l] = x[base + l] * c[l], b[l] = y[base + l] * c[l];
                    square[l] = p[l] * p[l] + q[l] * q[l], along[l] = p[l] * ex[l] + q[l] * ey[l];
                }
                const double *first[6] = {a, a, a, b, b, c}, *second[6] = {a, b, c, b, c, c};
                for (int k = 0; k < 6; ++k) {
                    double* sum = sums + k * LANES;
                    for (int l = 0; l < LANES; ++l) product[l] = first[k][l] * second[k][l];
                    for (int l = 0; l < LANES; ++l) {
                        sum[l] += product[l];
                        sum[l + 6 * LANES] += product[l] * p[l];
                        sum[l + 12 * LANES] += product[l] * q[l];
                        sum[l + 18 * LANES] += product[l] * square[l];
                    }
                }
                const double *left[3] = {a, b, c}, *right[3] = {ex, ey, along};
                for (int k = 0; k < 9; ++k) {
                    double* sum = sums + (24 + k) * LANES;
                    for (int l = 0; l < LANES; ++l) sum[l] += left[k % 3][l] * right[k / 3][l];
                }
            }
            for (int half = LANES / 2; half > 0; half /= 2)
                for (int i = 0; i < SUMS; ++i)
                    for (int l = 0; l < half; ++l)
                        sums[i * LANES + l] += sums[i * LANES + l + half];
            double total[SUMS];
            for (int i = 0; i < SUMS; ++i) total[i] = sums[i * LANES];
            fixed = Robust::step(kind, total, h);
        }
        float f[9];
        for (int i = 0; i < 9; ++i) f[i] = (float)h[i];
        int cost = 0, support = 0;
#pragma clang loop vectorize(assume_safety)
        for (int i = 0; i < count; ++i) {
            const float r = Robust::transfer(f, x[i], y[i], u[i], v[i]);
            cost += r < square ? (int)(r * scale + 0.5f) : COST_ONE;
            support += r < square;
        }
        if (round == 0 || cost <= costs.data[at] + (costs.data[at] >> 4)) {
            costs.data[at] = cost;
            supports.data[at] = support;
            for (int i = 0; i < 9; ++i) model[i] = h[i];
        }
    }
}

// Tell which matches are closer to a model than the threshold.
void mark_pair(int kind, wp::array_t<float> matches, int start, int count, float square, int at,
               wp::array_t<double> models, wp::array_t<unsigned char> inliers) {
    const size_t pitch = matches.shape[1];
    const float *x = matches.data + start, *y = x + pitch, *u = y + pitch, *v = u + pitch;
    float f[9];
    for (int i = 0; i < 9; ++i) f[i] = (float)models.data[9 * (size_t)at + i];
#pragma clang loop vectorize(assume_safety)
    for (int i = 0; i < count; ++i)
        inliers.data[start + i] = Robust::transfer(f, x[i], y[i], u[i], v[i]) < square;
}
