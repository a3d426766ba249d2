#include "_seen_cpu.h"

// A histogram of the distances of the points that aim at each centre; the rows of a slab are
// centres.
void vote_radii(int slab, int first, int last, wp::array_t<float> lines, wp::array_t<float> centers,
                float least, float most, float per_bin, Sight sight, wp::array_t<int> histograms) {
#pragma clang fp contract(off)
    const int bins = histograms.shape[1];
    for (int i = first; i < last; ++i) {
        const float cy = centers.data[2 * i], cx = centers.data[2 * i + 1];
        int* out = histograms.data + (size_t)i * bins;
        for (int b = 0; b < bins; ++b) out[b] = 0;
        Seen points(lines.data, lines.shape[1], cy, cx, least, most, sight.slack, sight.slope,
                    sight.first_side, sight.last_side);
        while (points.next()) {
            for (int k = 0; k < points.number; ++k) {
                if (!points.seen[k]) continue;
                const int b = (int)((points.far[k] - least) * per_bin);
                if (b < bins) ++out[b];
            }
        }
    }
}

// needs ARCS NORMAL_ONE FINE_ONE
// The sums of a least-squares fit. With n the normal of the circle and e the distance of a point
// from it, these are the sums of ny ny, ny nx, nx nx, ny, nx, 1, e ny, e nx and e over the points
// that aim at the circle's centre. The rows of a slab are circles.
void support(int slab, int first, int last, wp::array_t<float> lines, wp::array_t<float> circles,
             float band, Sight sight, wp::array_t<wp::int64> sums, wp::array_t<int> arcs) {
#pragma clang fp contract(off)
    for (int i = first; i < last; ++i) {
        const float cy = circles.data[3 * i], cx = circles.data[3 * i + 1];
        const float radius = circles.data[3 * i + 2], least = radius - band, most = radius + band;
        wp::int64* sum = sums.data + (size_t)i * 9;
        int* arc = arcs.data + (size_t)i * ARCS;
        for (int k = 0; k < 9; ++k) sum[k] = 0;
        for (int k = 0; k < ARCS; ++k) arc[k] = 0;
        Seen points(lines.data, lines.shape[1], cy, cx, least, most, sight.slack, sight.slope,
                    sight.first_side, sight.last_side);
        while (points.next()) {
            for (int k = 0; k < points.number; ++k) {
                const float d = points.far[k];
                if (!points.seen[k] || d <= 0.0f) continue;
                const int at = points.begin + k;
                const float dy = points.row[at] - cy, dx = points.column[at] - cx;
                const long long ny = (long long)__builtin_floorf(dy / d * (float)NORMAL_ONE + 0.5f);
                const long long nx = (long long)__builtin_floorf(dx / d * (float)NORMAL_ONE + 0.5f);
                const long long e =
                    (long long)__builtin_floorf((d - radius) * (float)FINE_ONE + 0.5f);
                sum[0] += ny * ny;
                sum[1] += ny * nx;
                sum[2] += nx * nx;
                sum[3] += ny;
                sum[4] += nx;
                sum[5] += 1;
                sum[6] += e * ny;
                sum[7] += e * nx;
                sum[8] += e;
                const float ay = __builtin_fabsf(dy), ax = __builtin_fabsf(dx);
                const bool steep = ay > ax;
                const int step = (int)((steep ? ax / ay : ay / ax) * (float)(ARCS / 8));
                const int octant = (dy < 0.0f) | (dx < 0.0f) << 1 | steep << 2;
                ++arc[octant * (ARCS / 8) + (step < ARCS / 8 ? step : ARCS / 8 - 1)];
            }
        }
    }
}
