#pragma once

// needs SEGMENT
// Where pixels of a new camera are seen by one with a lens, for either device. Arithmetic is in the
// order written, with no fused multiply-add; Taichi's undistortion.py has the same order.
struct Lens {
    // The parameters of `sample`: row i of the matrix is done with once for all columns.
    float n0, n3, n6, px, py, pz, fx, fy, cx, cy, k1, k2, p1, p2, k3, widest;

    Lens(const float* n, float i)
        : n0(n[0]),
          n3(n[3]),
          n6(n[6]),
          px(n[1] * i + n[2]),
          py(n[4] * i + n[5]),
          pz(n[7] * i + n[8]),
          fx(n[9]),
          fy(n[10]),
          cx(n[11]),
          cy(n[12]),
          k1(n[13]),
          k2(n[14]),
          p1(n[15]),
          p2(n[16]),
          k3(n[17]),
          widest(n[18]) {}

    // Column u and row v of the place where column j is seen; false where it is not.
    bool see(float j, float& u, float& v) const {
        const float z = n6 * j + pz;
        const float w = 1.0f / z;
        const float x = (n0 * j + px) * w, y = (n3 * j + py) * w;
        const float xx = x * x, yy = y * y, xy = x * y, r2 = xx + yy;
        const float radial = 1.0f + r2 * (k1 + r2 * (k2 + r2 * k3));
        u = fx * (x * radial + (2.0f * (p1 * xy) + p2 * (r2 + 2.0f * xx))) + cx;
        v = fy * (y * radial + (p1 * (r2 + 2.0f * yy) + 2.0f * (p2 * xy))) + cy;
        return (z > 0.0f) & (r2 < widest);
    }

    // Coefficients of the parabola through the places of columns 0, SEGMENT / 2 and SEGMENT.
    static void bend(float u0, float u1, float u2, float& a, float& b) {
        const float one = u1 - u0, two = u2 - u1;
        a = (3.0f * one - two) * (1.0f / SEGMENT);
        b = (two - one) * (2.0f / (SEGMENT * SEGMENT));
    }

    // Whether such a parabola u0 + t (a + t b) stays half a pixel or more above 0, and below `most`.
    // It lies within the triangle of its ends and of the point where the tangents there meet; no
    // rounding is half a pixel.
    static bool within(float u0, float a, float u2, float most) {
        const float bend = u0 + (0.5f * SEGMENT) * a;
        return (u0 >= 0.5f) & (bend >= 0.5f) & (u2 >= 0.5f) & (u0 <= most) & (bend <= most) &
               (u2 <= most);
    }
};
