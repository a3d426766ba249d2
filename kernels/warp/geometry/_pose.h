#include "_essential.h"
#pragma once

// Poses of a calibrated camera, from three points in space, for either device.
// taichi/geometry/_pose.py has the equations, and the same order of arithmetic. A model is two rows
// of R, then t: x = R X + t. `camera` is the 3 x 3 matrix from rays to points of the image,
// followed by its inverse.
struct Pose {
    // The projection K (R | t), (3, 4), of a model.
    ALONE static void project(const double* h, const double* camera, double* p) {
        double m[12];
        for (int i = 0; i < 2; ++i)
            for (int j = 0; j < 3; ++j) m[4 * i + j] = h[3 * i + j];
        for (int j = 0; j < 3; ++j) {
            const int a = (j + 1) % 3, b = (j + 2) % 3;
            m[8 + j] = h[a] * h[3 + b] - h[b] * h[3 + a];
            m[4 * j + 3] = h[6 + j];
        }
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 4; ++j)
                p[4 * i + j] = (camera[3 * i] * m[j] + camera[3 * i + 1] * m[4 + j]) +
                               camera[3 * i + 2] * m[8 + j];
    }

    // The squared distance of a projected point from where it is seen; infinite behind the camera.
    static float residual(const float* p, float x, float y, float z, float u, float v) {
        const float depth = ((p[8] * x + p[9] * y) + p[10] * z) + p[11];
        const float w = 1.0f / depth;
        const float dx = (((p[0] * x + p[1] * y) + p[2] * z) + p[3]) * w - u;
        const float dy = (((p[4] * x + p[5] * y) + p[6] * z) + p[7]) * w - v;
        return depth > 0.0f ? dx * dx + dy * dy : 1e30f;
    }

    // Make the rows of a rotation exactly of length 1 and square to one another.
    static bool straighten(double* h) {
        const double one = (h[0] * h[0] + h[1] * h[1]) + h[2] * h[2];
        if (!(one > 1e-300 && one < 1e300)) return false;
        const double first = 1.0 / wp::sqrt(one);
        for (int j = 0; j < 3; ++j) h[j] = h[j] * first;
        const double along = (h[0] * h[3] + h[1] * h[4]) + h[2] * h[5];
        for (int j = 0; j < 3; ++j) h[3 + j] = h[3 + j] - along * h[j];
        const double two = (h[3] * h[3] + h[4] * h[4]) + h[5] * h[5];
        if (!(two > 1e-300)) return false;
        const double second = 1.0 / wp::sqrt(two);
        for (int j = 0; j < 3; ++j) h[3 + j] = h[3 + j] * second;
        return true;
    }

    // Three vectors, by rows, of a triangle: along its first side, in its plane, square to it.
    static bool frame(const double* a, const double* b, const double* c, double* f) {
        for (int j = 0; j < 3; ++j) f[j] = b[j] - a[j], f[3 + j] = c[j] - a[j];
        if (!straighten(f)) return false;
        for (int j = 0; j < 3; ++j) {
            const int p = (j + 1) % 3, q = (j + 2) % 3;
            f[6 + j] = f[p] * f[3 + q] - f[q] * f[3 + p];
        }
        return true;
    }

    // Models of three points, at most four: Grunert's quartic [R. Haralick et al., IJCV 13(3),
    // 1994] for v = s3 / s1, where s are the distances from the camera.
    static int three(const double* x, const double* y, const double* z, const double* u,
                     const double* v, const double* camera, double flat, double* models) {
        double ray[9], point[9], world[9], p[12], found[12];
        for (int n = 0; n < 3; ++n) {
            point[3 * n] = x[n], point[3 * n + 1] = y[n], point[3 * n + 2] = z[n];
            double square = 0.0;
            for (int i = 0; i < 3; ++i) {
                const double* k = camera + 9 + 3 * i;
                ray[3 * n + i] = (k[0] * u[n] + k[1] * v[n]) + k[2];
                square = square + ray[3 * n + i] * ray[3 * n + i];
            }
            const double inverse = 1.0 / wp::sqrt(square);
            for (int i = 0; i < 3; ++i) ray[3 * n + i] = ray[3 * n + i] * inverse;
        }
        double side[3], angle[3];  // squares of sides, cosines: opposite of each point
        for (int n = 0; n < 3; ++n) {
            const int a = 3 * ((n + 1) % 3), b = 3 * ((n + 2) % 3);
            side[n] = 0.0, angle[n] = 0.0;
            for (int i = 0; i < 3; ++i) {
                const double gap = point[a + i] - point[b + i];
                side[n] = side[n] + gap * gap;
                angle[n] = angle[n] + ray[a + i] * ray[b + i];
            }
            if (!(side[n] > flat)) return 0;
        }
        if (!frame(point, point + 3, point + 6, world)) return 0;
        const double A = side[0] / side[1], C = side[2] / side[1], D = A - C;
        const double ca = angle[0], cb = angle[1], cg = angle[2];
        const double aa = ca * ca, bb = cb * cb, gg = cg * cg, ag = ca * cg;
        p[4] = (D - 1.0) * (D - 1.0) - 4.0 * C * aa;
        p[3] = 4.0 * ((D * (1.0 - D) * cb - (1.0 - (A + C)) * ag) + 2.0 * C * aa * cb);
        p[2] = 2.0 * ((((D * D - 1.0) + 2.0 * (D * D) * bb) + 2.0 * (1.0 - C) * aa) +
                      (2.0 * (1.0 - A) * gg - 4.0 * (A + C) * (ag * cb)));
        p[1] = 4.0 * ((2.0 * A * gg * cb - D * (1.0 + D) * cb) - (1.0 - (A + C)) * ag);
        p[0] = (1.0 + D) * (1.0 + D) - 4.0 * A * gg;
        int count = 0;
        for (int turn = 0; turn < 2; ++turn) {
            double q[5];
            for (int k = 0; k < 5; ++k) q[k] = turn ? p[4 - k] : p[k];
            const int number = Epipolar::roots(q, 4, found);
            for (int n = 0; n < number && count < 4; ++n) {
                if (!(found[n] > 1e-6)) continue;
                const double far = turn ? 1.0 / found[n] : found[n];
                const double under = 2.0 * (cg - far * ca);
                if (!(wp::abs(under) > 1e-9)) continue;
                const double near =
                    (((D - 1.0) * (far * far) - 2.0 * D * cb * far) + (1.0 + D)) / under;
                const double one = side[1] / ((1.0 + far * far) - 2.0 * far * cb);
                if (!(near > 0.0) || !(one > 0.0)) continue;
                const double s = wp::sqrt(one);
                double seen[9], camera_frame[9];
                for (int i = 0; i < 3; ++i) {
                    seen[i] = s * ray[i];
                    seen[3 + i] = near * s * ray[3 + i];
                    seen[6 + i] = far * s * ray[6 + i];
                }
                if (!frame(seen, seen + 3, seen + 6, camera_frame)) continue;
                double rotation[9], *h = models + 9 * count;
                for (int i = 0; i < 3; ++i)
                    for (int j = 0; j < 3; ++j)
                        rotation[3 * i + j] =
                            (camera_frame[i] * world[j] + camera_frame[3 + i] * world[3 + j]) +
                            camera_frame[6 + i] * world[6 + j];
                for (int i = 0; i < 6; ++i) h[i] = rotation[i];
                for (int i = 0; i < 3; ++i)
                    h[6 + i] =
                        seen[i] - ((rotation[3 * i] * point[0] + rotation[3 * i + 1] * point[1]) +
                                   rotation[3 * i + 2] * point[2]);
                ++count;
            }
        }
        return count;
    }

    // Compute both residuals of a match, their derivatives by a turn and a shift, and the weight w;
    // return false if the match is beyond the limit. `p` is the projection of the model h.
    static bool derive(const double* h, const double* p, const double* camera, double x, double y,
                       double z, double u, double v, double limit, double* t, double* e,
                       double& w) {
        const double depth = ((p[8] * x + p[9] * y) + p[10] * z) + p[11];
        const double inverse = 1.0 / depth;
        const double px = (((p[0] * x + p[1] * y) + p[2] * z) + p[3]) * inverse;
        const double py = (((p[4] * x + p[5] * y) + p[6] * z) + p[7]) * inverse;
        e[0] = px - u, e[1] = py - v;
        const double a = (h[0] * x + h[1] * y) + h[2] * z, b = (h[3] * x + h[4] * y) + h[5] * z;
        const double third[3] = {h[1] * h[5] - h[2] * h[4], h[2] * h[3] - h[0] * h[5],
                                 h[0] * h[4] - h[1] * h[3]};
        const double c = (third[0] * x + third[1] * y) + third[2] * z;
        for (int i = 0; i < 2; ++i) {
            double* g = t + 6 * i;
            const double at = i ? py : px;
            g[3] = (camera[3 * i] - at * camera[6]) * inverse;
            g[4] = (camera[3 * i + 1] - at * camera[7]) * inverse;
            g[5] = (camera[3 * i + 2] - at * camera[8]) * inverse;
            g[0] = b * g[5] - c * g[4], g[1] = c * g[3] - a * g[5], g[2] = a * g[4] - b * g[3];
        }
        const double square = e[0] * e[0] + e[1] * e[1];
        w = Epipolar::weight(square, limit);
        return (depth > 0.0) & (square < limit);
    }

    // One Gauss-Newton step from the sums of 21 products of slopes, and of six by residuals.
    static bool step(const double* sums, double* h) {
        double a[60], d[6], trace = 0.0;
        int at = 0;
        for (int i = 0; i < 6; ++i) {
            for (int j = i; j < 6; ++j, ++at) a[10 * i + j] = a[10 * j + i] = sums[at];
            a[10 * i + 9] = -sums[21 + i];
        }
        for (int i = 0; i < 6; ++i) trace = trace + a[11 * i];
        if (!Epipolar::eliminate(a, 6, 1e-13 * trace, d)) return false;
        // Cayley's rotation by (d0, d1, d2) / 2, of the first two rows' columns.
        const double r[3] = {0.5 * d[0], 0.5 * d[1], 0.5 * d[2]};
        const double square = (r[0] * r[0] + r[1] * r[1]) + r[2] * r[2], under = 1.0 + square;
        double turned[6];
        for (int j = 0; j < 3; ++j) {
            const int k = (j + 1) % 3, l = (j + 2) % 3;
            const double c[3] = {h[j], h[3 + j], h[k] * h[3 + l] - h[l] * h[3 + k]};
            const double along = (r[0] * c[0] + r[1] * c[1]) + r[2] * c[2];
            for (int i = 0; i < 2; ++i) {
                const int m = (i + 1) % 3, n = (i + 2) % 3;
                const double across = r[m] * c[n] - r[n] * c[m];
                turned[3 * i + j] =
                    (((1.0 - square) * c[i] + 2.0 * along * r[i]) + 2.0 * across) / under;
            }
        }
        for (int i = 0; i < 6; ++i) h[i] = turned[i];
        for (int i = 0; i < 3; ++i) h[6 + i] = h[6 + i] + d[3 + i];
        return straighten(h);
    }
};
