#include "_epipolar.h"
#pragma once

// Essential matrices of calibrated cameras, from five matches, for either device.
// taichi/geometry/_essential.py has the equations, and the same order of arithmetic.
// `cameras` are four matrices of 3 x 3: from points of the first and of the second image to rays,
// and back. Models are fundamental matrices, of points: A1' E A0.
struct Essential {
    // F = A1' E A0, or with the inverse matrices the way back.
    ALONE static void between(const double* a1, const double* e, const double* a0, double* f) {
        double half[9];
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                half[3 * i + j] =
                    (e[3 * i] * a0[j] + e[3 * i + 1] * a0[3 + j]) + e[3 * i + 2] * a0[6 + j];
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                f[3 * i + j] =
                    (a1[i] * half[j] + a1[3 + i] * half[3 + j]) + a1[6 + i] * half[6 + j];
    }

    // Column of the monomial of three of x, y, z and 1, in Nister's order.
    static int column(int i, int j, int k) {
        const int base[16] = {16, 13, 6, 1, 10, 8, 3, 0, 4, 2, 0, 0, 0, 0, 0, 0};
        const int along = (i == 0) + (j == 0) + (k == 0), down = (i == 1) + (j == 1) + (k == 1);
        return base[4 * along + down] + (i == 3) + (j == 3) + (k == 3);
    }

    // Coefficients, (10, 20), of 2 E E' E - tr(E E') E = 0 and det E = 0 for E = x X + y Y + z Z + W.
    static void constraints(const double* basis, double* m) {
        for (int i = 0; i < 200; ++i) m[i] = 0.0;
        for (int i = 0; i < 4; ++i)
            for (int j = i; j < 4; ++j) {
                const double *p = basis + 9 * i, *q = basis + 9 * j;
                double s[9], c[3];
                for (int a = 0; a < 3; ++a)
                    for (int b = 0; b < 3; ++b) {
                        double sum = (p[3 * a] * q[3 * b] + p[3 * a + 1] * q[3 * b + 1]) +
                                     p[3 * a + 2] * q[3 * b + 2];
                        if (i < j)
                            sum = sum + ((q[3 * a] * p[3 * b] + q[3 * a + 1] * p[3 * b + 1]) +
                                         q[3 * a + 2] * p[3 * b + 2]);
                        s[3 * a + b] = sum;
                    }
                for (int a = 0; a < 3; ++a) {
                    const int b = (a + 1) % 3, d = (a + 2) % 3;
                    c[a] = p[3 + b] * q[6 + d] - p[3 + d] * q[6 + b];
                    if (i < j) c[a] = c[a] + (q[3 + b] * p[6 + d] - q[3 + d] * p[6 + b]);
                }
                const double trace = (s[0] + s[4]) + s[8];
                for (int k = 0; k < 4; ++k) {
                    const double* e = basis + 9 * k;
                    const int at = column(i, j, k);
                    for (int a = 0; a < 3; ++a)
                        for (int b = 0; b < 3; ++b) {
                            const double sum = (s[3 * a] * e[b] + s[3 * a + 1] * e[3 + b]) +
                                               s[3 * a + 2] * e[6 + b];
                            double* to = m + 20 * (3 * a + b) + at;
                            *to = *to + (2.0 * sum - trace * e[3 * a + b]);
                        }
                    m[180 + at] = m[180 + at] + ((e[0] * c[0] + e[1] * c[1]) + e[2] * c[2]);
                }
            }
    }

    // Eliminate the ten monomials of degree 2 and 3 in x and y; rows 4 to 9 are as wanted then.
    static bool reduce(double* m) {
        for (int k = 0; k < 10; ++k) {
            double most = 0.0;
            int pivot = k;
            for (int i = k; i < 10; ++i)
                if (wp::abs(m[20 * i + k]) > most) most = wp::abs(m[20 * i + k]), pivot = i;
            if (!(most > 1e-12)) return false;
            for (int j = k; j < 20; ++j) {
                const double other = m[20 * k + j];
                m[20 * k + j] = m[20 * pivot + j], m[20 * pivot + j] = other;
            }
            const double inverse = 1.0 / m[20 * k + k];
            for (int j = k + 1; j < 20; ++j) m[20 * k + j] = m[20 * k + j] * inverse;
            for (int i = 4; i < 10; ++i) {
                if (i == k) continue;
                const double factor = m[20 * i + k];
                for (int j = k + 1; j < 20; ++j)
                    m[20 * i + j] = m[20 * i + j] - factor * m[20 * k + j];
            }
            for (int i = k + 1; i < 4; ++i) {
                const double factor = m[20 * i + k];
                for (int j = k + 1; j < 20; ++j)
                    m[20 * i + j] = m[20 * i + j] - factor * m[20 * k + j];
            }
        }
        return true;
    }

    // Add, or subtract, the product of two polynomials, lowest coefficient first.
    ALONE static void multiply(const double* a, int n, const double* b, int k, double sign,
                               double* to) {
        for (int i = 0; i <= n; ++i)
            for (int j = 0; j <= k; ++j) to[i + j] = to[i + j] + sign * (a[i] * b[j]);
    }

    // Polynomials in z, (3, 3, 5), of the equations in (x, y, 1), and their determinant's.
    static void polynomials(const double* m, double* b, double* p) {
        for (int r = 0; r < 3; ++r) {
            const double *e = m + 20 * (4 + 2 * r), *f = e + 20;
            for (int c = 0; c < 3; ++c) {
                double* to = b + 15 * r + 5 * c;
                const int first = 10 + 3 * c, top = c == 2 ? 3 : 2;
                to[4] = 0.0;
                to[0] = e[first + top];
                for (int k = 1; k <= top; ++k) to[k] = e[first + top - k] - f[first + top + 1 - k];
                to[top + 1] = -f[first];
            }
        }
        for (int k = 0; k <= 10; ++k) p[k] = 0.0;
        for (int r = 0; r < 3; ++r) {
            const double *one = b + 15 * ((r + 1) % 3), *other = b + 15 * ((r + 2) % 3);
            double minor[7] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
            multiply(one, 3, other + 5, 3, 1.0, minor);
            multiply(one + 5, 3, other, 3, -1.0, minor);
            multiply(minor, 6, b + 15 * r + 10, 4, 1.0, p);
        }
    }

    // The equations of the polynomials at z fix x and y; false where they do not.
    static bool unknowns(const double* b, double z, double* x) {
        double at[9], most = 0.0;
        for (int i = 0; i < 9; ++i) {
            const double* p = b + 5 * i;
            double value = p[4];
            for (int k = 3; k >= 0; --k) value = value * z + p[k];
            at[i] = value;
        }
        for (int r = 0; r < 3; ++r) {
            const double *p = at + 3 * ((r + 1) % 3), *q = at + 3 * ((r + 2) % 3);
            const double w = p[0] * q[1] - p[1] * q[0];
            if (wp::abs(w) > most) {
                most = wp::abs(w);
                x[0] = (p[1] * q[2] - p[2] * q[1]) / w;
                x[1] = (p[2] * q[0] - p[0] * q[2]) / w;
            }
        }
        return most > 0.0;
    }

    // Models of five matches, at most ten [D. Nister, IEEE PAMI 26(6), 2004].
    static int five(const double* x, const double* y, const double* u, const double* v,
                    const double* cameras, double* models) {
        double m[200], basis[36], b[45], p[12], found[12];
        for (int n = 0; n < 5; ++n) {
            double rays[6];
            for (int i = 0; i < 3; ++i) {
                const double *a0 = cameras + 3 * i, *a1 = cameras + 9 + 3 * i;
                rays[i] = (a0[0] * x[n] + a0[1] * y[n]) + a0[2];
                rays[3 + i] = (a1[0] * u[n] + a1[1] * v[n]) + a1[2];
            }
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j) m[9 * n + 3 * i + j] = rays[3 + i] * rays[j];
        }
        if (!Epipolar::null_space(m, 5, basis)) return 0;
        constraints(basis, m);
        if (!reduce(m)) return 0;
        polynomials(m, b, p);
        int count = 0;
        for (int side = 0; side < 2; ++side) {
            double q[11];
            for (int k = 0; k <= 10; ++k) q[k] = side ? p[10 - k] : p[k];
            const int number = Epipolar::roots(q, 10, found);
            for (int n = 0; n < number && count < 10; ++n) {
                if (side && !(wp::abs(found[n]) > 1e-9)) continue;
                double at[2], e[9];
                const double z = side ? 1.0 / found[n] : found[n];
                if (!unknowns(b, z, at)) continue;
                for (int k = 0; k < 9; ++k)
                    e[k] = ((at[0] * basis[k] + at[1] * basis[9 + k]) + z * basis[18 + k]) +
                           basis[27 + k];
                double* model = models + 9 * count;
                between(cameras + 9, e, cameras, model);
                if (Epipolar::unit(model)) ++count;
            }
        }
        return count;
    }

    // Move a matrix to the nearest one with two equal singular values and one of 0, by Newton's
    // steps: E (3 I - c E'E) / 2 with c = 2 / |E|^2, and E - det E / |C|^2 C with its cofactors C.
    static void polish(double* e) {
        for (int round = 0; round < 3; ++round) {
            double square = 0.0, g[9], c[9], determinant = 0.0;
            for (int i = 0; i < 9; ++i) square = square + e[i] * e[i];
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j)
                    g[3 * i + j] = (e[3 * i] * e[3 * j] + e[3 * i + 1] * e[3 * j + 1]) +
                                   e[3 * i + 2] * e[3 * j + 2];
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j)
                    c[3 * i + j] =
                        (g[3 * i] * e[j] + g[3 * i + 1] * e[3 + j]) + g[3 * i + 2] * e[6 + j];
            for (int i = 0; i < 9; ++i) e[i] = 1.5 * e[i] - c[i] / square;
            Epipolar::cofactors(e, c);
            square = 0.0;
            for (int i = 0; i < 9; ++i) square = square + c[i] * c[i];
            for (int i = 0; i < 3; ++i) determinant = determinant + e[i] * c[i];
            for (int i = 0; i < 9; ++i) e[i] = e[i] - determinant / square * c[i];
        }
    }

    // One Gauss-Newton step: E is turned a little from either side, E + [a] E + E [b].
    static bool step(const double* sums, const double* cameras, double* h) {
        double e[9], moves[54], slopes[54], n[81], product[54], a[60], d[6];
        between(cameras + 27, h, cameras + 18, e);
        for (int k = 0; k < 3; ++k) {
            const int p = (k + 1) % 3, q = (k + 2) % 3;
            double *left = moves + 9 * k, *right = moves + 9 * (3 + k);
            for (int i = 0; i < 3; ++i) {
                left[3 * k + i] = 0.0, right[3 * i + k] = 0.0;
                left[3 * p + i] = -e[3 * q + i], left[3 * q + i] = e[3 * p + i];
                right[3 * i + p] = e[3 * i + q], right[3 * i + q] = -e[3 * i + p];
            }
        }
        for (int k = 0; k < 6; ++k) between(cameras + 9, moves + 9 * k, cameras, slopes + 9 * k);
        int at = 0;
        for (int i = 0; i < 9; ++i)
            for (int j = i; j < 9; ++j, ++at) n[9 * i + j] = n[9 * j + i] = sums[at];
        double trace = 0.0;
        for (int k = 0; k < 6; ++k) {
            const double* slope = slopes + 9 * k;
            double right = 0.0;
            for (int i = 0; i < 9; ++i) {
                double sum = 0.0;
                for (int j = 0; j < 9; ++j) sum = sum + n[9 * i + j] * slope[j];
                product[9 * k + i] = sum;
                right = right + slope[i] * sums[45 + i];
            }
            for (int l = 0; l < 6; ++l) {
                double sum = 0.0;
                for (int i = 0; i < 9; ++i) sum = sum + slopes[9 * l + i] * product[9 * k + i];
                a[10 * k + l] = sum;
            }
            a[10 * k + 9] = -right;
            trace = trace + a[11 * k];
        }
        // A turn about the epipole, of both sides, moves nothing: it is held.
        for (int k = 0; k < 6; ++k) a[11 * k] = a[11 * k] + 1e-9 * trace;
        if (!Epipolar::eliminate(a, 6, 1e-13 * trace, d)) return false;
        for (int k = 0; k < 6; ++k)
            for (int i = 0; i < 9; ++i) e[i] = e[i] + d[k] * moves[9 * k + i];
        polish(e);
        double moved[9];
        between(cameras + 9, e, cameras, moved);
        if (!Epipolar::unit(moved)) return false;
        for (int i = 0; i < 9; ++i) h[i] = moved[i];
        return true;
    }
};
