#include "_triangulation.h"

// needs NEWTON_STEPS, WIDEST, LENS_STEPS, NEAR
// A ray of a camera and the line of a projector that lights it. The Taichi set does the same
// operations in the same order, without fused products, and has the same bits.
struct Meeting {
    // The ray of a pixel, by Newton's method. If there is none, the result is arbitrary, but never
    // so far away that a ray has no direction.
    static void straighten(const float* lens, float row, float column, float& x, float& y) {
        const float wanted_x = (column - lens[2]) / lens[0], wanted_y = (row - lens[3]) / lens[1];
        x = wanted_x, y = wanted_y;
#pragma unroll
        for (int step = 0; step < NEWTON_STEPS; ++step) {
            float u, v, xx, xy, yy;
            Light::bend(lens, x, y, u, v, xx, xy, yy);
            const float inverse = 1.0f / (xx * yy - xy * xy);
            const float off_x = (u - wanted_x) * inverse, off_y = (v - wanted_y) * inverse;
            x -= yy * off_x - xy * off_y, y -= xx * off_y - xy * off_x;
        }
        const bool near = (x < WIDEST) & (x > -WIDEST) & (y < WIDEST) & (y > -WIDEST);
        x = near ? x : wanted_x, y = near ? y : wanted_y;
    }

    // The depth at which a ray (x, y, 1) of the camera is lit by a line of the projector, by
    // Newton's method in the inverse of the depth w: the projector sees R d + w t. 0 where that is
    // not before both.
    static float meet(const float* lens, const float* pose, int axis, float place, float x,
                      float y) {
        const float across = pose[0] * x + pose[1] * y + pose[2];
        const float down = pose[3] * x + pose[4] * y + pose[5];
        const float ahead = pose[6] * x + pose[7] * y + pose[8];
        const float wanted = (place - lens[2 + axis]) / lens[axis];
        const float along = axis ? down : across, shift = axis ? pose[10] : pose[9];
        // Without a lens the line lies at the wanted place.
        float w = (along - wanted * ahead) / (wanted * pose[11] - shift), off = 0.0f, depth = 0.0f;
#pragma unroll
        for (int step = 0; step < LENS_STEPS; ++step) {
            depth = ahead + w * pose[11];
            const float inverse = 1.0f / depth;
            const float p = (across + w * pose[9]) * inverse, q = (down + w * pose[10]) * inverse;
            const float dp = (pose[9] - p * pose[11]) * inverse;
            const float dq = (pose[10] - q * pose[11]) * inverse;
            float u, v, xx, xy, yy;
            Light::bend(lens, p, q, u, v, xx, xy, yy);
            const float slope = axis ? xy * dp + yy * dq : xx * dp + xy * dq;
            off = (axis ? v : u) - wanted;
            w -= off / slope;
        }
        const bool met = (off < NEAR) & (off > -NEAR) & (w > 0.0f) & (depth > 0.0f);
        const float z = 1.0f / w;
        return (met & (z <= 3.4028235e38f)) ? z : 0.0f;
    }
};
