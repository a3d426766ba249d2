#pragma once

// The lens of OpenCV, fx, fy, cx, cy, k1, k2, p1, p2, k3. cvkern/geometry/cameras/lens.py has the
// equations.
struct Light {
    // The place where a ray is seen, for f = 1, and its derivatives.
    static void bend(const float* lens, float x, float y, float& u, float& v, float& xx, float& xy,
                     float& yy) {
        const float k1 = lens[4], k2 = lens[5], p1 = lens[6], p2 = lens[7], k3 = lens[8];
        const float r2 = x * x + y * y;
        const float radial = 1.0f + r2 * (k1 + r2 * (k2 + r2 * k3));
        const float slope = 2.0f * (k1 + r2 * (2.0f * k2 + 3.0f * k3 * r2));
        const float b = 2.0f * (p1 * x + p2 * y), c = 2.0f * p1 * y, d = 2.0f * p2 * x;
        u = x * (radial + c) + p2 * (r2 + 2.0f * x * x);
        v = y * (radial + d) + p1 * (r2 + 2.0f * y * y);
        xx = radial + slope * x * x + c + 3.0f * d;
        yy = radial + slope * y * y + 3.0f * c + d;
        xy = slope * x * y + b;
    }
};
