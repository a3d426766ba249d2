#include "_triangulation.h"

// needs STILL, NEAR
// Steps of Newton's method to the ray of a camera and to the line of a projector that lights it,
// until one is short. The Taichi set does the same operations in the same order, without fused
// products, and has the same bits.
struct Meeting {
    // A step towards the ray (x, y, 1) that is seen at a place; whether it was long. If there is no
    // such ray, the steps lead anywhere.
    static bool straighten(const float* lens, float wanted_x, float wanted_y, float& x, float& y) {
        float u, v, xx, xy, yy;
        Light::bend(lens, x, y, u, v, xx, xy, yy);
        const float inverse = 1.0f / (xx * yy - xy * xy);
        const float off_x = (u - wanted_x) * inverse, off_y = (v - wanted_y) * inverse;
        const float step_x = yy * off_x - xy * off_y, step_y = xx * off_y - xy * off_x;
        x -= step_x, y -= step_y;
        return !((step_x < STILL) & (step_x > -STILL) & (step_y < STILL) & (step_y > -STILL));
    }

    // A ray of the camera, as the projector sees it: R d + w t at the depth 1 / w.
    float across, down, ahead;

    Meeting(const float* pose, float x, float y)
        : across(pose[0] * x + pose[1] * y + pose[2]),
          down(pose[3] * x + pose[4] * y + pose[5]),
          ahead(pose[6] * x + pose[7] * y + pose[8]) {}

    // w where a line at the wanted place lights the ray, without a lens.
    float begin(const float* pose, int axis, float wanted) const {
        const float along = axis ? down : across, shift = axis ? pose[10] : pose[9];
        return (along - wanted * ahead) / (wanted * pose[11] - shift);
    }

    // A step of w; how far off the line is before it, and at which depth of the projector.
    void meet(const float* lens, const float* pose, int axis, float wanted, float& w, float& off,
              float& depth) const {
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

    // The depth of a ray, 0 where it is not lit before camera and projector.
    static float depth_of(float w, float off, float depth) {
        const bool met = (off < NEAR) & (off > -NEAR) & (w > 0.0f) & (depth > 0.0f);
        const float z = 1.0f / w;
        return (met & (z <= 3.4028235e38f)) ? z : 0.0f;
    }
};
