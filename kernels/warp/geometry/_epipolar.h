#pragma once

// Fundamental matrices for either device: from seven matches, from a plane, and their refinement.
// taichi/geometry/_epipolar.py has the equations, and the same order of arithmetic.

// Functions with several callers stay functions on the CPU, where copies of them in each caller
// would double the time of compiling.
#if defined(__CUDA_ARCH__)
#define ALONE
#else
#define ALONE __attribute__((noinline))
#endif
struct Epipolar {
    // Solve A d = b, n unknowns, positive definite; rows of 10 numbers, the last is b's.
    ALONE static bool eliminate(double* a, int n, double least, double* d) {
        for (int k = 0; k < n; ++k) {
            const double* row = a + 10 * k;
            if (!(row[k] > least)) return false;
            for (int i = k + 1; i < n; ++i) {
                double* below = a + 10 * i;
                const double factor = below[k] / row[k];
                for (int j = k + 1; j < n; ++j) below[j] = below[j] - factor * row[j];
                below[9] = below[9] - factor * row[9];
            }
        }
        for (int k = n - 1; k >= 0; --k) {
            double sum = a[10 * k + 9];
            for (int j = k + 1; j < n; ++j) sum = sum - a[10 * k + j] * d[j];
            d[k] = sum / a[10 * k + k];
        }
        return true;
    }

    // Scale a matrix to a largest element of 1; false where there is none.
    ALONE static bool unit(double* h) {
        double largest = 0.0;
        for (int i = 0; i < 9; ++i) largest = wp::abs(h[i]) > largest ? wp::abs(h[i]) : largest;
        if (!(largest > 0.0 && largest < 1e300)) return false;
        const double inverse = 1.0 / largest;
        for (int i = 0; i < 9; ++i) h[i] = h[i] * inverse;
        return true;
    }

    // Null vectors of r equations in nine unknowns, by Gauss-Jordan elimination with the largest
    // pivot of a row, of equals the first; false below a least pivot.
    ALONE static bool null_space(double* m, int r, double* vectors) {
        int name[9];
        for (int j = 0; j < 9; ++j) name[j] = j;
        for (int k = 0; k < r; ++k) {
            double most = 0.0;
            int column = k;
            for (int j = k; j < 9; ++j) {
                const double size = wp::abs(m[9 * k + j]);
                column = size > most ? j : column;
                most = size > most ? size : most;
            }
            if (!(most > 1e-9)) return false;
            for (int i = 0; i < r; ++i) {
                const double other = m[9 * i + k];
                m[9 * i + k] = m[9 * i + column], m[9 * i + column] = other;
            }
            const int other = name[k];
            name[k] = name[column], name[column] = other;
            const double inverse = 1.0 / m[9 * k + k];
            for (int j = k + 1; j < 9; ++j) m[9 * k + j] = m[9 * k + j] * inverse;
            for (int i = 0; i < r; ++i) {
                if (i == k) continue;
                const double factor = m[9 * i + k];
                for (int j = k + 1; j < 9; ++j) m[9 * i + j] = m[9 * i + j] - factor * m[9 * k + j];
            }
        }
        for (int n = r; n < 9; ++n) {
            double* vector = vectors + 9 * (n - r);
            for (int j = r; j < 9; ++j) vector[name[j]] = j == n ? 1.0 : 0.0;
            for (int i = 0; i < r; ++i) vector[name[i]] = -m[9 * i + n];
        }
        return true;
    }

    ALONE static void cofactors(const double* f, double* c) {
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) {
                const int a = (i + 1) % 3, b = (i + 2) % 3, p = (j + 1) % 3, q = (j + 2) % 3;
                c[3 * i + j] = f[3 * a + p] * f[3 * b + q] - f[3 * a + q] * f[3 * b + p];
            }
    }

    // Scale a polynomial, whose coefficients lie 12 apart, to a largest one of 1; return its degree,
    // or -1.
    static int scale(double* p, int degree) {
        double most = 0.0;
        for (int k = 0; k <= degree; ++k)
            most = wp::abs(p[12 * k]) > most ? wp::abs(p[12 * k]) : most;
        const bool some = most > 1e-300;
        const double inverse = 1.0 / most;
        for (int k = 0; k <= degree; ++k) p[12 * k] = some ? p[12 * k] * inverse : 0.0;
        if (!some) return -1;
        while (degree > 0 && wp::abs(p[12 * degree]) < 1e-12) p[12 * degree--] = 0.0;
        return degree;
    }

    // How often the signs of Sturm's chain change at t; all of its polynomials at once.
    ALONE static int changes(const double* chain, int degree, double t) {
        double at[12], last = 0.0;
        int count = 0;
        for (int i = 0; i < 12; ++i) at[i] = chain[12 * degree + i];
        for (int k = degree - 1; k >= 0; --k)
            for (int i = 0; i < 12; ++i) at[i] = at[i] * t + chain[12 * k + i];
        for (int i = 0; i <= degree; ++i) {
            count += last * at[i] < 0.0;  // 0 is no sign
            last = at[i] != 0.0 ? at[i] : last;
        }
        return count;
    }

    // A polynomial at t, and its derivative.
    static double value(const double* p, int degree, double t, double& slope) {
        double value = p[12 * degree];
        slope = 0.0;
        for (int k = degree - 1; k >= 0; --k) {
            slope = slope * t + value;
            value = value * t + p[12 * k];
        }
        return value;
    }

    // Real roots in (-1, 1]; p has up to 12 coefficients, lowest first. Sturm's chain and bisection
    // tell where a root is alone. From there Newton's steps lead to it, and bisection where these
    // leave the interval or do not halve the step before.
    ALONE static int roots(const double* p, int degree, double* found) {
        double chain[144];  // by powers: those of all polynomials lie side by side
        for (int k = 0; k < 144; ++k) chain[k] = 0.0;
        for (int k = 0; k <= degree; ++k) chain[12 * k] = p[k];
        degree = scale(chain, degree);
        if (degree < 1) return 0;
        for (int k = 0; k < degree; ++k) chain[12 * k + 1] = (double)(k + 1) * chain[12 * k + 12];
        int from = degree, to = scale(chain + 1, degree - 1);
        for (int i = 2; to > 0; ++i) {
            const double *above = chain + i - 2, *by = chain + i - 1;
            double* rest = chain + i;
            const double inverse = 1.0 / by[12 * to];
            for (int k = 0; k <= from; ++k) rest[12 * k] = -above[12 * k];
            for (int d = from; d >= to; --d) {
                const double factor = rest[12 * d] * inverse;
                for (int k = 0; k < to; ++k)
                    rest[12 * (d - to + k)] = rest[12 * (d - to + k)] - factor * by[12 * k];
                rest[12 * d] = 0.0;
            }
            from = to, to = scale(rest, to - 1);
        }
        const int before = changes(chain, degree, -1.0);
        const int count = before - changes(chain, degree, 1.0);
        double begin = -1.0;
        for (int n = 0; n < count; ++n) {
            double low = begin, high = 1.0, slope;
            int below = n, upto = count;  // the number of roots in (-1, low] and in (-1, high]
            for (int step = 0; step < 36 && upto - below > 1; ++step) {
                const double middle = (low + high) * 0.5;
                const int now = before - changes(chain, degree, middle);
                if (now > n)
                    high = middle, upto = now;
                else
                    low = middle, below = now;
            }
            begin = high;
            const double top = value(chain, degree, high, slope);
            double x = (low + high) * 0.5, last = high - low;
            for (int step = 0; step < 48 && last > 1e-11; ++step) {
                const double at = value(chain, degree, x, slope);
                const bool above = top > 0.0 ? at >= 0.0 : (top < 0.0) & (at <= 0.0);
                high = above ? x : high;
                low = above ? low : x;
                const double next = x - at / slope, moved = wp::abs(next - x);
                const bool good = (next > low) & (next < high) & (moved + moved <= last);
                const double there = good ? next : (low + high) * 0.5;
                last = wp::abs(there - x);
                x = there;
            }
            found[n] = x;
        }
        return count > 0 ? count : 0;
    }

    // Matrices of seven matches, at most three: det(A + t B) = 0, or det(t A + B) = 0.
    static int seven(const double* x, const double* y, const double* u, const double* v,
                     double* models) {
        double m[63], null[18], c[9], p[4], found[4];
        for (int i = 0; i < 7; ++i) {
            const double row[9] = {u[i] * x[i], u[i] * y[i], u[i], v[i] * x[i], v[i] * y[i],
                                   v[i],        x[i],        y[i], 1.0};
            for (int j = 0; j < 9; ++j) m[9 * i + j] = row[j];
        }
        if (!null_space(m, 7, null)) return 0;
        double *a = null, *b = null + 9;
        cofactors(a, c);
        p[0] = 0.0, p[1] = 0.0, p[2] = 0.0, p[3] = 0.0;
        for (int k = 0; k < 3; ++k) p[0] = p[0] + a[k] * c[k];
        for (int k = 0; k < 9; ++k) p[1] = p[1] + b[k] * c[k];
        cofactors(b, c);
        for (int k = 0; k < 3; ++k) p[3] = p[3] + b[k] * c[k];
        for (int k = 0; k < 9; ++k) p[2] = p[2] + a[k] * c[k];
        int count = 0;
        for (int side = 0; side < 2; ++side) {
            const double q[4] = {p[3], p[2], p[1], p[0]};
            const int number = roots(side ? q : p, 3, found);
            for (int n = 0; n < number && count < 3; ++n, ++count)
                for (int k = 0; k < 9; ++k)
                    models[9 * count + k] = side ? found[n] * a[k] + b[k] : a[k] + found[n] * b[k];
        }
        return count;
    }

    // The matrix of a plane's homography and two matches off the plane: lines from where the
    // plane would be to where the points are meet in the epipole e; F = [e] H.
    static int parallax(const double* x, const double* y, const double* u, const double* v,
                        const double* h, double* models) {
        double line[6], e[3];
        for (int i = 0; i < 2; ++i) {
            double q[3];
            for (int k = 0; k < 3; ++k)
                q[k] = (h[3 * k] * x[i] + h[3 * k + 1] * y[i]) + h[3 * k + 2];
            line[3 * i] = v[i] * q[2] - q[1];
            line[3 * i + 1] = q[0] - u[i] * q[2];
            line[3 * i + 2] = u[i] * q[1] - v[i] * q[0];
        }
        double most = 0.0;
        for (int k = 0; k < 3; ++k) {
            const int p = (k + 1) % 3, q = (k + 2) % 3;
            e[k] = line[p] * line[3 + q] - line[q] * line[3 + p];
            most = wp::abs(e[k]) > most ? wp::abs(e[k]) : most;
        }
        if (!(most > 1e-12)) return 0;
        for (int k = 0; k < 3; ++k) e[k] = e[k] / most;
        for (int j = 0; j < 3; ++j) {
            models[j] = e[1] * h[6 + j] - e[2] * h[3 + j];
            models[3 + j] = e[2] * h[j] - e[0] * h[6 + j];
            models[6 + j] = e[0] * h[3 + j] - e[1] * h[j];
        }
        return 1;
    }

    // The square of Sampson's distance.
    static float sampson(const float* h, float x, float y, float u, float v) {
        const float a = (h[0] * x + h[1] * y) + h[2], b = (h[3] * x + h[4] * y) + h[5];
        const float c = (h[6] * x + h[7] * y) + h[8];
        const float d = (h[0] * u + h[3] * v) + h[6], e = (h[1] * u + h[4] * v) + h[7];
        const float n = (a * u + b * v) + c;
        return n * n / ((a * a + b * b) + (d * d + e * e));
    }

    // The weight of a squared residual: Cauchy's, of a third of the limit's root, fading to 0 there.
    static double weight(double square, double limit) {
        const double x = square / limit, rest = 1.0 - x;
        return rest * rest / (1.0 + 10.0 * x);
    }

    // Compute the derivatives t of the equation of a match, its value n, and the square w of its
    // weight; return false if the match is beyond the limit.
    static bool derive(const double* h, double x, double y, double u, double v, double limit,
                       double* t, double& n, double& w) {
        const double a = (h[0] * x + h[1] * y) + h[2], b = (h[3] * x + h[4] * y) + h[5];
        const double c = (h[6] * x + h[7] * y) + h[8];
        const double d = (h[0] * u + h[3] * v) + h[6], e = (h[1] * u + h[4] * v) + h[7];
        n = (a * u + b * v) + c;
        w = 1.0 / ((a * a + b * b) + (d * d + e * e));
        const double square = n * n * w;
        const double s = n * w, p = u - s * a, q = v - s * b, f = s * d, g = s * e;
        t[0] = p * x - f * u, t[1] = p * y - g * u, t[2] = p;
        t[3] = q * x - f * v, t[4] = q * y - g * v, t[5] = q;
        t[6] = x - f, t[7] = y - g, t[8] = 1.0;
        w = w * weight(square, limit);
        return square < limit;
    }

    // Normal equations of a step, rows of 10 numbers, from the sums of products t t and t n: the
    // step is square to F, whose scale is free, and leads to a determinant of 0.
    static bool equations(const double* sums, const double* h, double* a, double& trace) {
        int k = 0;
        for (int i = 0; i < 9; ++i) {
            for (int j = i; j < 9; ++j, ++k) a[10 * i + j] = a[10 * j + i] = sums[k];
            a[10 * i + 9] = -sums[45 + i];
        }
        trace = 0.0;
        for (int i = 0; i < 9; ++i) trace = trace + a[11 * i];
        double c[9], determinant = 0.0, square = 0.0;
        cofactors(h, c);
        for (int i = 0; i < 3; ++i) determinant = determinant + h[i] * c[i];
        for (int i = 0; i < 9; ++i) square = square + c[i] * c[i];
        if (!(square > 1e-30)) return false;
        const double weight = 1e6 * trace / square;
        for (int i = 0; i < 9; ++i) {
            for (int j = 0; j < 9; ++j)
                a[10 * i + j] = (a[10 * i + j] + trace * h[i] * h[j]) + weight * c[i] * c[j];
            a[10 * i + 9] = a[10 * i + 9] - weight * determinant * c[i];
        }
        return true;
    }
};
