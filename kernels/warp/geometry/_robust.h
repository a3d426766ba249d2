#include "_pose.h"
#pragma once

// Samples, minimal solvers, residuals and least-squares steps of robust fits, for either device.
// taichi/geometry/robust.py has the method, and the same order of arithmetic: no multiply-add is
// fused.
struct Robust {
    enum Model { SIMILARITY, AFFINE, HOMOGRAPHY, FUNDAMENTAL, PARALLAX, ESSENTIAL, POSE };

    static unsigned mix(unsigned x) {  // kernels/warp/_random.py
        const unsigned state = x * 747796405u + 2891336453u;
        const unsigned word = ((state >> ((state >> 28) + 4u)) ^ state) * 277803737u;
        return (word >> 22) ^ word;
    }

    static int index(int seed, int hypothesis, int which, int count) {
        const unsigned x = mix((unsigned)seed ^ 0x1E3779B9u * (unsigned)which);
        const unsigned bits = mix((unsigned)hypothesis + mix(x));
        return (int)((unsigned long long)bits * (unsigned long long)count >> 32);
    }

    // Matches of a sample; slot s draws number s + 8 n until its match is in no slot before.
    static bool sample(int seed, int hypothesis, int count, int size, int* picked) {
        for (int s = 0; s < size; ++s) {
            bool fresh = false;
            for (int n = 0; n < 16 && !fresh; ++n) {
                picked[s] = index(seed, hypothesis, s + 8 * n, count);
                fresh = true;
                for (int r = 0; r < s; ++r) fresh = fresh && picked[r] != picked[s];
            }
            if (!fresh) return false;
        }
        return true;
    }

    // Twice the area of the triangle a, b, c.
    static double area(const double* x, const double* y, int a, int b, int c) {
        return (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a]);
    }

    // The map of four points, by barycentric coordinates: with a_i(p) those of p in the triangle
    // of the first three, s_i = a_i(p3) and t_i the same in the second image, H maps p to the sum
    // of (t_i / s_i) a_i(p) q_i. All four must be before the horizon, in either image.
    static bool homography(const double* x, const double* y, const double* u, const double* v,
                           double flat, double* h) {
        double s[4], t[4];
        for (int side = 0; side < 2; ++side) {
            const double* a = side ? u : x;
            const double* b = side ? v : y;
            double* of = side ? t : s;
            of[0] = area(a, b, 3, 1, 2);
            of[1] = area(a, b, 0, 3, 2);
            of[2] = area(a, b, 0, 1, 3);
            of[3] = area(a, b, 0, 1, 2);
        }
        const bool mirrored = s[3] * t[3] < 0.0;
        for (int i = 0; i < 4; ++i) {
            if (!(wp::abs(s[i]) > flat) || !(wp::abs(t[i]) > flat)) return false;
            if ((s[i] * t[i] < 0.0) != mirrored) return false;
        }
        double scale[3];
        for (int i = 0; i < 3; ++i) scale[i] = t[i] / s[i];
        barycentric(x, y, u, v, scale, h);
        return true;
    }

    static bool affine(const double* x, const double* y, const double* u, const double* v,
                       double flat, double* h) {
        const double whole = area(x, y, 0, 1, 2);
        if (!(wp::abs(whole) > flat) || !(wp::abs(area(u, v, 0, 1, 2)) > flat)) return false;
        const double scale[3] = {1.0 / whole, 1.0 / whole, 1.0 / whole};
        barycentric(x, y, u, v, scale, h);
        h[6] = 0.0, h[7] = 0.0, h[8] = 1.0;
        return true;
    }

    // The map of p to the sum over three points of scale_i a_i(p) q_i.
    ALONE static void barycentric(const double* x, const double* y, const double* u,
                                  const double* v, const double* scale, double* h) {
        for (int i = 0; i < 9; ++i) h[i] = 0.0;
        for (int i = 0; i < 3; ++i) {
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            const double row[3] = {y[j] - y[k], x[k] - x[j], x[j] * y[k] - x[k] * y[j]};
            for (int c = 0; c < 3; ++c) {
                const double scaled = row[c] * scale[i];
                h[c] += u[i] * scaled, h[3 + c] += v[i] * scaled, h[6 + c] += scaled;
            }
        }
    }

    static bool similarity(const double* x, const double* y, const double* u, const double* v,
                           double flat, double* h) {
        const double dx = x[1] - x[0], dy = y[1] - y[0], du = u[1] - u[0], dv = v[1] - v[0];
        const double square = dx * dx + dy * dy;
        if (!(square > flat) || !(du * du + dv * dv > flat)) return false;
        const double a = (dx * du + dy * dv) / square, b = (dx * dv - dy * du) / square;
        h[0] = a, h[1] = -b, h[2] = u[0] - (a * x[0] - b * y[0]);
        h[3] = b, h[4] = a, h[5] = v[0] - (b * x[0] + a * y[0]);
        h[6] = 0.0, h[7] = 0.0, h[8] = 1.0;
        return true;
    }

    // The models of one hypothesis, at most ten; their number. Matches x0, y0, x1, y1, and z0 of a
    // scene, lie `pitch` apart. `known` is the homography of a plane, or cameras.
    static int solve(int kind, const float* matches, size_t pitch, int count, int seed,
                     int hypothesis, double flat, const double* known, double* models) {
        int picked[8];
        const int sizes[7] = {2, 3, 4, 7, 2, 5, 3};
        const int size = sizes[kind];
        if (!sample(seed, hypothesis, count, size, picked)) return 0;
        double x[8], y[8], u[8], v[8], z[8];
        for (int i = 0; i < size; ++i) {
            const float* match = matches + picked[i];
            x[i] = match[0], y[i] = match[pitch], u[i] = match[2 * pitch], v[i] = match[3 * pitch];
            if (kind == POSE) z[i] = match[4 * pitch];
        }
        if (kind == FUNDAMENTAL) return Epipolar::seven(x, y, u, v, models);
        if (kind == PARALLAX) return Epipolar::parallax(x, y, u, v, known, models);
        if (kind == ESSENTIAL) return Essential::five(x, y, u, v, known, models);
        if (kind == POSE) return Pose::three(x, y, z, u, v, known, flat, models);
        if (kind == SIMILARITY) return similarity(x, y, u, v, flat, models);
        return kind == AFFINE ? affine(x, y, u, v, flat, models)
                              : homography(x, y, u, v, flat, models);
    }

    // Compute the numbers from which residuals follow: nine of a matrix, or twelve of a projection.
    static void prepare(int kind, const float* model, const double* known, float* f) {
        if (kind != POSE) {
            for (int i = 0; i < 9; ++i) f[i] = model[i];
            return;
        }
        double h[9], p[12];
        for (int i = 0; i < 9; ++i) h[i] = model[i];
        Pose::project(h, known, p);
        for (int i = 0; i < 12; ++i) f[i] = (float)p[i];
    }

    // The squared residual of a match.
    static float residual(int kind, const float* f, const float* match, size_t pitch) {
        const float x = match[0], y = match[pitch], u = match[2 * pitch], v = match[3 * pitch];
        if (kind == POSE) return Pose::residual(f, x, y, match[4 * pitch], u, v);
        return kind < FUNDAMENTAL ? transfer(f, x, y, u, v) : Epipolar::sampson(f, x, y, u, v);
    }

    // The squared distance of H (x, y) from (u, v).
    static float transfer(const float* h, float x, float y, float u, float v) {
        const float w = 1.0f / ((h[6] * x + h[7] * y) + h[8]);
        const float dx = ((h[0] * x + h[1] * y) + h[2]) * w - u;
        const float dy = ((h[3] * x + h[4] * y) + h[5]) * w - v;
        return dx * dx + dy * dy;
    }

    // One Gauss-Newton step from the sums over all matches; false where they fix no model.
    static bool step(int kind, const double* sums, const double* known, double* h) {
        if (kind == ESSENTIAL) return Essential::step(sums, known, h);
        if (kind == POSE) return Pose::step(sums, h);
        // Normal equations of all nine elements: blocks of 3 x 3 by rows of H.
        double full[90], a[90], d[9];
        if (kind == FUNDAMENTAL) {
            double whole;
            if (!Epipolar::equations(sums, h, a, whole)) return false;
            if (!Epipolar::eliminate(a, 9, 1e-13 * whole, d)) return false;
            for (int i = 0; i < 9; ++i) h[i] = h[i] + d[i];
            Epipolar::unit(h);
            return true;
        }
        const int place[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) {
                const int p = place[3 * i + j];
                full[10 * i + j] = full[10 * (i + 3) + j + 3] = sums[p];
                full[10 * i + j + 3] = full[10 * (i + 3) + j] = 0.0;
                full[10 * i + j + 6] = full[10 * (j + 6) + i] = -sums[6 + p];
                full[10 * (i + 3) + j + 6] = full[10 * (j + 6) + i + 3] = -sums[12 + p];
                full[10 * (i + 6) + j + 6] = sums[18 + p];
            }
            full[10 * i + 9] = -sums[24 + i];
            full[10 * (i + 3) + 9] = -sums[27 + i];
            full[10 * (i + 6) + 9] = sums[30 + i];
        }
        if (kind == SIMILARITY) {  // h = (a, -b, c, b, a, d, 0, 0, 1)
            const int at[8] = {0, 4, 3, 1, 2, 2, 5, 5};
            const double sign[8] = {1.0, 1.0, 1.0, -1.0, 0.5, 0.5, 0.5, 0.5};
            for (int i = 0; i < 4; ++i) {
                const int p = at[2 * i], q = at[2 * i + 1];
                const double f = sign[2 * i], g = sign[2 * i + 1];
                for (int j = 0; j < 4; ++j) {
                    const int r = at[2 * j], t = at[2 * j + 1];
                    const double m = sign[2 * j], n = sign[2 * j + 1];
                    const double one = f * full[10 * p + r] * m + f * full[10 * p + t] * n;
                    a[10 * i + j] = one + (g * full[10 * q + r] * m + g * full[10 * q + t] * n);
                }
                a[10 * i + 9] = f * full[10 * p + 9] + g * full[10 * q + 9];
            }
        } else {
            for (int i = 0; i < 90; ++i) a[i] = full[i];
        }
        const int n = kind == SIMILARITY ? 4 : kind == AFFINE ? 6 : 9;
        double trace = 0.0;
        for (int i = 0; i < n; ++i) trace = trace + a[11 * i];
        if (kind == HOMOGRAPHY)  // the scale of H is free: the step is square to it
            for (int i = 0; i < 9; ++i)
                for (int j = 0; j < 9; ++j) a[10 * i + j] = a[10 * i + j] + trace * h[i] * h[j];
        if (!Epipolar::eliminate(a, n, 1e-13 * trace, d)) return false;
        if (kind == SIMILARITY) {
            h[0] = h[0] + d[0], h[4] = h[0], h[3] = h[3] + d[1], h[1] = -h[3];
            h[2] = h[2] + d[2], h[5] = h[5] + d[3];
        } else {
            for (int i = 0; i < n; ++i) h[i] = h[i] + d[i];
        }
        if (kind == HOMOGRAPHY) Epipolar::unit(h);
        return true;
    }

    // Add what one match gives to the sums of a step; it counts below the limit.
    static void add(int kind, const double* h, const double* known, const float* match,
                    size_t pitch, double limit, double* sums) {
        const double x = match[0], y = match[pitch], u = match[2 * pitch], v = match[3 * pitch];
        if (kind == POSE) {
            double p[12], t[12], e[2], w;
            Pose::project(h, known, p);
            if (!Pose::derive(h, p, known, x, y, match[4 * pitch], u, v, limit, t, e, w)) return;
            int k = 0;
            for (int i = 0; i < 6; ++i) {
                const double one = t[i] * w, two = t[6 + i] * w;
                for (int j = i; j < 6; ++j, ++k) sums[k] += one * t[j] + two * t[6 + j];
                sums[21 + i] += one * e[0] + two * e[1];
            }
            return;
        }
        if (kind >= FUNDAMENTAL) {
            double t[9], n, w;
            if (!Epipolar::derive(h, x, y, u, v, limit, t, n, w)) return;
            int k = 0;
            for (int i = 0; i < 9; ++i) {
                const double weighed = t[i] * w;
                for (int j = i; j < 9; ++j, ++k) sums[k] += weighed * t[j];
                sums[45 + i] += weighed * n;
            }
            return;
        }
        const double inverse = 1.0 / ((h[6] * x + h[7] * y) + h[8]);
        const double px = ((h[0] * x + h[1] * y) + h[2]) * inverse;
        const double py = ((h[3] * x + h[4] * y) + h[5]) * inverse;
        const double rx = px - u, ry = py - v;
        if (!(rx * rx + ry * ry < limit)) return;
        const double c = inverse, a = x * c, b = y * c;
        const double products[6] = {a * a, a * b, a * c, b * b, b * c, c * c};
        const double square = px * px + py * py, along = px * rx + py * ry;
        for (int i = 0; i < 6; ++i) {
            sums[i] += products[i];
            sums[6 + i] += products[i] * px;
            sums[12 + i] += products[i] * py;
            sums[18 + i] += products[i] * square;
        }
        sums[24] += a * rx, sums[25] += b * rx, sums[26] += c * rx;
        sums[27] += a * ry, sums[28] += b * ry, sums[29] += c * ry;
        sums[30] += a * along, sums[31] += b * along, sums[32] += c * along;
    }
};
