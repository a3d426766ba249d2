#include "_robust.h"
#pragma once

// Costs and least-squares sums over matches in vectors of COUNT lanes. The steps are those of
// Robust (_robust.h) for one match.
struct Lanes {
    enum { COUNT = 32, SUMS = 54, ONE = 4096 };

    // The cost of a model over matches in fixed point, and the number of its inliers.
    ALONE static int cost(int kind, const float* f, const double* known, const float* x,
                          size_t pitch, int count, float square, int& support) {
        const float *y = x + pitch, *u = y + pitch, *v = u + pitch, *z = v + pitch;
        const float scale = ONE / square;
        float h[12];
        Robust::prepare(kind, f, known, h);
        int cost = 0, inside = 0;
        if (kind < Robust::FUNDAMENTAL) {
#pragma clang loop vectorize(assume_safety)
            for (int i = 0; i < count; ++i) {
                const float r = Robust::transfer(h, x[i], y[i], u[i], v[i]);
                cost += r < square ? (int)(r * scale + 0.5f) : ONE;
                inside += r < square;
            }
        } else if (kind == Robust::POSE) {
#pragma clang loop vectorize(assume_safety)
            for (int i = 0; i < count; ++i) {
                const float r = Pose::residual(h, x[i], y[i], z[i], u[i], v[i]);
                cost += r < square ? (int)(r * scale + 0.5f) : ONE;
                inside += r < square;
            }
        } else {
#pragma clang loop vectorize(assume_safety)
            for (int i = 0; i < count; ++i) {
                const float r = Epipolar::sampson(h, x[i], y[i], u[i], v[i]);
                cost += r < square ? (int)(r * scale + 0.5f) : ONE;
                inside += r < square;
            }
        }
        support = inside;
        return cost;
    }

    // Add `COUNT` matches, those below `left` that are within the limit, to the sums of the lanes.
    static void add(const double* h, const float* x, size_t pitch, int left, double limit,
                    double* sums) {
        const float *y = x + pitch, *u = y + pitch, *v = u + pitch;
        double a[COUNT], b[COUNT], c[COUNT], p[COUNT], q[COUNT], ex[COUNT], ey[COUNT];
        double square[COUNT], along[COUNT], product[COUNT];
#pragma clang loop vectorize(assume_safety)
        for (int l = 0; l < COUNT; ++l) {
            const double inverse = 1.0 / ((h[6] * x[l] + h[7] * y[l]) + h[8]);
            const double px = ((h[0] * x[l] + h[1] * y[l]) + h[2]) * inverse;
            const double py = ((h[3] * x[l] + h[4] * y[l]) + h[5]) * inverse;
            const double rx = px - u[l], ry = py - v[l];
            const bool counts = (l < left) & (rx * rx + ry * ry < limit);
            p[l] = counts ? px : 0.0, q[l] = counts ? py : 0.0;
            ex[l] = counts ? rx : 0.0, ey[l] = counts ? ry : 0.0;
            c[l] = counts ? inverse : 0.0;
        }
        for (int l = 0; l < COUNT; ++l) {
            a[l] = x[l] * c[l], b[l] = y[l] * c[l];
            square[l] = p[l] * p[l] + q[l] * q[l], along[l] = p[l] * ex[l] + q[l] * ey[l];
        }
        const double *first[6] = {a, a, a, b, b, c}, *second[6] = {a, b, c, b, c, c};
        for (int k = 0; k < 6; ++k) {
            double* sum = sums + k * COUNT;
            for (int l = 0; l < COUNT; ++l) product[l] = first[k][l] * second[k][l];
            for (int l = 0; l < COUNT; ++l) {
                sum[l] += product[l];
                sum[l + 6 * COUNT] += product[l] * p[l];
                sum[l + 12 * COUNT] += product[l] * q[l];
                sum[l + 18 * COUNT] += product[l] * square[l];
            }
        }
        const double *one[3] = {a, b, c}, *other[3] = {ex, ey, along};
        for (int k = 0; k < 9; ++k) {
            double* sum = sums + (24 + k) * COUNT;
            for (int l = 0; l < COUNT; ++l) sum[l] += one[k % 3][l] * other[k / 3][l];
        }
    }

    // Add those of `count` matches that are within the limit. Each lane lists its own first, so
    // that the sums, which take longest, meet few others; their order in a lane is the same.
    static void add_listed(const double* h, const float* x, size_t pitch, int count, double limit,
                           double* sums) {
        enum { LISTED = 64 };
        const float *y = x + pitch, *u = y + pitch, *v = u + pitch;
        int list[COUNT][LISTED + 1], near[COUNT], number[COUNT];
        float some[4 * COUNT];
        for (int first = 0; first < count; first += LISTED * COUNT) {
            for (int l = 0; l < COUNT; ++l) number[l] = 0;
            const int last = count - first < LISTED * COUNT ? count : first + LISTED * COUNT;
            for (int base = first; base < last; base += COUNT) {
#pragma clang loop vectorize(assume_safety)
                for (int l = 0; l < COUNT; ++l) {
                    const int i = base + l;
                    const double inverse = 1.0 / ((h[6] * x[i] + h[7] * y[i]) + h[8]);
                    const double rx = ((h[0] * x[i] + h[1] * y[i]) + h[2]) * inverse - u[i];
                    const double ry = ((h[3] * x[i] + h[4] * y[i]) + h[5]) * inverse - v[i];
                    near[l] = (i < count) & (rx * rx + ry * ry < limit);
                }
                for (int l = 0; l < COUNT; ++l) {
                    list[l][number[l]] = base + l;
                    number[l] += near[l];
                }
            }
            int most = 0;
            for (int l = 0; l < COUNT; ++l) most = number[l] > most ? number[l] : most;
            for (int k = 0; k < most; ++k) {
                for (int l = 0; l < COUNT; ++l) {
                    const bool there = k < number[l];
                    const int i = there ? list[l][k] : first;
                    some[l] = x[i], some[COUNT + l] = y[i], some[3 * COUNT + l] = v[i];
                    some[2 * COUNT + l] = there ? u[i] : 3e38f;  // beyond any limit
                }
                add(h, some, COUNT, COUNT, limit, sums);
            }
        }
    }

    // The same for matches of an epipolar geometry.
    static void add_epipolar(const double* h, const float* x, size_t pitch, int left, double limit,
                             double* sums) {
        const float *y = x + pitch, *u = y + pitch, *v = u + pitch;
        double t[9][COUNT], value[COUNT], weight[COUNT], weighed[COUNT];
#pragma clang loop vectorize(assume_safety)
        for (int l = 0; l < COUNT; ++l) {
            double one[9], n, w;
            const bool near = Epipolar::derive(h, x[l], y[l], u[l], v[l], limit, one, n, w);
            const bool counts = (l < left) & near;
            value[l] = counts ? n : 0.0, weight[l] = counts ? w : 0.0;
            t[0][l] = counts ? one[0] : 0.0, t[1][l] = counts ? one[1] : 0.0;
            t[2][l] = counts ? one[2] : 0.0, t[3][l] = counts ? one[3] : 0.0;
            t[4][l] = counts ? one[4] : 0.0, t[5][l] = counts ? one[5] : 0.0;
            t[6][l] = counts ? one[6] : 0.0, t[7][l] = counts ? one[7] : 0.0;
            t[8][l] = counts ? one[8] : 0.0;
        }
        double* sum = sums;
        for (int i = 0; i < 9; ++i) {
            for (int l = 0; l < COUNT; ++l) weighed[l] = t[i][l] * weight[l];
            for (int j = i; j < 9; ++j, sum += COUNT)
                for (int l = 0; l < COUNT; ++l) sum[l] += weighed[l] * t[j][l];
            double* right = sums + (45 + i) * COUNT;
            for (int l = 0; l < COUNT; ++l) right[l] += weighed[l] * value[l];
        }
    }

    // The same for points of a scene.
    static void add_pose(const double* h, const double* camera, const float* x, size_t pitch,
                         int left, double limit, double* sums) {
        const float *y = x + pitch, *u = y + pitch, *v = u + pitch, *z = v + pitch;
        double t[12][COUNT], e[2][COUNT], p[12], weight[COUNT], one[COUNT], two[COUNT];
        Pose::project(h, camera, p);
        for (int l = 0; l < COUNT; ++l) {
            double slope[12], gap[2], w;
            const bool near =
                Pose::derive(h, p, camera, x[l], y[l], z[l], u[l], v[l], limit, slope, gap, w);
            const bool counts = (l < left) & near;
            weight[l] = counts ? w : 0.0;
            for (int i = 0; i < 12; ++i) t[i][l] = counts ? slope[i] : 0.0;
            for (int i = 0; i < 2; ++i) e[i][l] = counts ? gap[i] : 0.0;
        }
        double* sum = sums;
        for (int i = 0; i < 6; ++i) {
            for (int l = 0; l < COUNT; ++l)
                one[l] = t[i][l] * weight[l], two[l] = t[6 + i][l] * weight[l];
            for (int j = i; j < 6; ++j, sum += COUNT)
                for (int l = 0; l < COUNT; ++l) sum[l] += one[l] * t[j][l] + two[l] * t[6 + j][l];
            double* right = sums + (21 + i) * COUNT;
            for (int l = 0; l < COUNT; ++l) right[l] += one[l] * e[0][l] + two[l] * e[1][l];
        }
    }

    // Steps of least squares from a model, each over the matches below a limit of its own.
    static void improve(int kind, const double* known, const float* x, size_t pitch, int count,
                        float square, const float* schedule, int steps, double* h) {
        const int number = kind == Robust::POSE ? 27 : kind >= Robust::FUNDAMENTAL ? 54 : 33;
        for (int s = 0; s < steps; ++s) {
            const double limit = (double)square * (double)schedule[s];
            if (!(limit > 0.0)) return;  // no match fixes a step
            double sums[SUMS * COUNT], total[SUMS];
            for (int i = 0; i < number * COUNT; ++i) sums[i] = 0.0;
            if (kind < Robust::FUNDAMENTAL) add_listed(h, x, pitch, count, limit, sums);
            for (int base = 0; base < count && kind >= Robust::FUNDAMENTAL; base += COUNT) {
                if (kind == Robust::POSE)
                    add_pose(h, known, x + base, pitch, count - base, limit, sums);
                else
                    add_epipolar(h, x + base, pitch, count - base, limit, sums);
            }
            for (int half = COUNT / 2; half > 0; half /= 2)
                for (int i = 0; i < number; ++i)
                    for (int l = 0; l < half; ++l)
                        sums[i * COUNT + l] += sums[i * COUNT + l + half];
            for (int i = 0; i < number; ++i) total[i] = sums[i * COUNT];
            if (!Robust::step(kind, total, known, h)) return;
        }
    }
};
