#pragma once

// needs NEWTON_STEPS, WIDEST, LENS_STEPS, NEAR, STOPS, STILL
// A ray of a camera and the line of a projector that lights it, for either device. On the CPU the
// Taichi set does the same operations in the same order, without fused products, and has the same
// bits. cvkern/geometry/cameras/lens.py has the equations of a lens, fx, fy, cx, cy, k1, k2, p1, p2,
// k3. With STOPS, steps end where the last one was shorter than STILL: vectors of pixels take all of
// them.
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

    // A quotient, on CUDA within 2 units of the last place.
    static float quotient(float a, float b) {
#if STOPS
        return __fdividef(a, b);
#else
        return a / b;
#endif
    }

    // The ray of a pixel, by Newton's method. If there is none, the result is arbitrary, but never
    // so far away that a ray has no direction. The steps begin as far from where the ray would be
    // without a lens as a neighbour's ended; with STOPS, this distance is renewed.
    static void straighten(const float* lens, float row, float column, float* moved, float& x,
                           float& y) {
        const float wanted_x = (column - lens[2]) / lens[0], wanted_y = (row - lens[3]) / lens[1];
        x = wanted_x + moved[0], y = wanted_y + moved[1];
        bool still = false;
#pragma unroll
        for (int step = 0; step < NEWTON_STEPS; ++step) {
            float u, v, xx, xy, yy;
            bend(lens, x, y, u, v, xx, xy, yy);
            const float inverse = quotient(1.0f, xx * yy - xy * xy);
            const float off_x = (u - wanted_x) * inverse, off_y = (v - wanted_y) * inverse;
            const float step_x = yy * off_x - xy * off_y, step_y = xx * off_y - xy * off_x;
            x -= step_x, y -= step_y;
            still = STOPS && wp::abs(step_x) < STILL && wp::abs(step_y) < STILL;
            if (still) break;
        }
        const bool near = (x < WIDEST) & (x > -WIDEST) & (y < WIDEST) & (y > -WIDEST);
        x = near ? x : wanted_x, y = near ? y : wanted_y;
        if (STOPS) {
            moved[0] = still && near ? x - wanted_x : 0.0f;
            moved[1] = still && near ? y - wanted_y : 0.0f;
        }
    }

    // The depth at which a ray (x, y, 1) of the camera is lit by a line of the projector, by
    // Newton's method in the inverse of the depth w: the projector sees R d + w t. 0 where that is
    // not before both. `moved` is as above, along the axis.
    static float meet(const float* lens, const float* pose, int axis, float place, float* moved,
                      float x, float y) {
        const float across = pose[0] * x + pose[1] * y + pose[2];
        const float down = pose[3] * x + pose[4] * y + pose[5];
        const float ahead = pose[6] * x + pose[7] * y + pose[8];
        const float wanted = (place - lens[2 + axis]) / lens[axis];
        const float along = axis ? down : across, shift = axis ? pose[10] : pose[9];
        // Without a lens the line lies at the wanted place.
        const float line = wanted + moved[0];
        float w = quotient(along - line * ahead, line * pose[11] - shift), off = 0.0f, depth = 0.0f;
        float found = line;
#pragma unroll
        for (int step = 0; step < LENS_STEPS; ++step) {
            depth = ahead + w * pose[11];
            const float inverse = quotient(1.0f, depth);
            const float p = (across + w * pose[9]) * inverse, q = (down + w * pose[10]) * inverse;
            const float dp = (pose[9] - p * pose[11]) * inverse;
            const float dq = (pose[10] - q * pose[11]) * inverse;
            float u, v, xx, xy, yy;
            bend(lens, p, q, u, v, xx, xy, yy);
            const float slope = axis ? xy * dp + yy * dq : xx * dp + xy * dq;
            off = (axis ? v : u) - wanted;
            w -= quotient(off, slope);
            found = axis ? q : p;
            if (STOPS && wp::abs(off) < STILL) break;
        }
        const bool met = (off < NEAR) & (off > -NEAR) & (w > 0.0f) & (depth > 0.0f);
        const float z = quotient(1.0f, w);
        // Where it is not met, a neighbour begins without a lens.
        if (STOPS) moved[0] = met ? found - wanted : 0.0f;
        return (met & (z <= 3.4028235e38f)) ? z : 0.0f;
    }
};
