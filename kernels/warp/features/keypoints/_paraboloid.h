#pragma once

// The fit of a paraboloid to an extremum, for either device;
// taichi/features/keypoints/refinement.py has the equations, in the same order of arithmetic.
struct Paraboloid {
    const float* base;          // levels of an octave
    int levels, height, width;  // inner levels
    double oy, ox, os, top;

    double difference(int s, int y, int x) const {
        const size_t plane = (size_t)height * width;
        const float* const p = base + s * plane + (size_t)y * width + x;
        return (double)(p[plane] - p[0]);
    }

    // Move (s, y, x) to the pixel where the paraboloid has its extremum; tell whether it is kept.
    bool fit(float contrast, float edge, int margin, int moves, int& s, int& y, int& x) {
        oy = ox = os = top = 0.0;
        for (int n = 0; n < moves; ++n) {
            const double c = difference(s, y, x);
            const double u = difference(s, y - 1, x), d = difference(s, y + 1, x);
            const double l = difference(s, y, x - 1), r = difference(s, y, x + 1);
            const double b = difference(s - 1, y, x), a = difference(s + 1, y, x);
            const double gy = 0.5 * (d - u), gx = 0.5 * (r - l), gs = 0.5 * (a - b);
            const double yy = d + u - c - c, xx = r + l - c - c, ss = a + b - c - c;
            const double xy = 0.25 * (difference(s, y + 1, x + 1) - difference(s, y + 1, x - 1) -
                                      difference(s, y - 1, x + 1) + difference(s, y - 1, x - 1));
            const double xs = 0.25 * (difference(s + 1, y, x + 1) - difference(s + 1, y, x - 1) -
                                      difference(s - 1, y, x + 1) + difference(s - 1, y, x - 1));
            const double ys = 0.25 * (difference(s + 1, y + 1, x) - difference(s + 1, y - 1, x) -
                                      difference(s - 1, y + 1, x) + difference(s - 1, y - 1, x));
            // The inverse by cofactors.
            const double m00 = yy * ss - ys * ys, m01 = xs * ys - xy * ss, m02 = xy * ys - xs * yy;
            const double det = xx * m00 + xy * m01 + xs * m02;
            if (det == 0.0) return false;
            const double m11 = xx * ss - xs * xs, m12 = xy * xs - xx * ys, m22 = xx * yy - xy * xy;
            ox = -((m00 * gx + m01 * gy + m02 * gs) / det);
            oy = -((m01 * gx + m11 * gy + m12 * gs) / det);
            os = -((m02 * gx + m12 * gy + m22 * gs) / det);
            if (wp::abs(ox) < 0.5 && wp::abs(oy) < 0.5 && wp::abs(os) < 0.5) {
                top = c + 0.5 * (gx * ox + gy * oy + gs * os);
                const double trace = xx + yy;
                // This is tr^2 / det < edge, for a positive det.
                return wp::abs(top) >= (double)contrast && m22 > 0.0 &&
                       trace * trace < (double)edge * m22;
            }
            // Beyond two pixels the fit means nothing.
            if (!(wp::abs(ox) < 3.0 && wp::abs(oy) < 3.0 && wp::abs(os) < 3.0)) return false;
            x += (int)floor(ox + 0.5);
            y += (int)floor(oy + 0.5);
            s += (int)floor(os + 0.5);
            if (s < 1 || s > levels || y < margin || y >= height - margin || x < margin ||
                x >= width - margin)
                return false;
        }
        return false;
    }
};
