#include "_triangulation.h"

// needs NEWTON_STEPS, WIDEST, LENS_STEPS, NEAR, STILL, AXIS
// Newton's steps for several pixels at once, until the last ones were shorter than STILL. Quotients
// are within 2 units of the last place. _meeting_cpu.h has the equations.
struct Meeting {
    float lens[18], pose[12], inverse[4];  // 1 / fx, 1 / fy of the camera, and of the projector

    Meeting(const float* lenses, const float* to) {
#pragma unroll
        for (int k = 0; k < 18; ++k) lens[k] = lenses[k];
#pragma unroll
        for (int k = 0; k < 12; ++k) pose[k] = to[k];
        inverse[0] = 1.0f / lens[0], inverse[1] = 1.0f / lens[1];
        inverse[2] = 1.0f / lens[9], inverse[3] = 1.0f / lens[10];
    }

    // Where a pixel would be seen without a lens.
    float across(float column) const { return (column - lens[2]) * inverse[0]; }
    float down(float row) const { return (row - lens[3]) * inverse[1]; }

    // The rays of `count` pixels, at most four, seen at (wanted, height), from x and y on.
    void straighten(int count, const float* wanted, float height, float* x, float* y) const {
        bool still = false;
        for (int step = 0; step < NEWTON_STEPS && !still; ++step) {
            still = true;
#pragma unroll
            for (int n = 0; n < 4 && n < count; ++n) {
                float u, v, xx, xy, yy;
                Light::bend(lens, x[n], y[n], u, v, xx, xy, yy);
                const float over = __fdividef(1.0f, xx * yy - xy * xy);
                const float off_x = (u - wanted[n]) * over, off_y = (v - height) * over;
                const float step_x = yy * off_x - xy * off_y, step_y = xx * off_y - xy * off_x;
                x[n] -= step_x, y[n] -= step_y;
                still = still & (fabsf(step_x) < STILL) & (fabsf(step_y) < STILL);
            }
        }
#pragma unroll
        for (int n = 0; n < 4 && n < count; ++n) {
            const bool near = fabsf(x[n]) < WIDEST && fabsf(y[n]) < WIDEST;
            x[n] = near ? x[n] : wanted[n], y[n] = near ? y[n] : height;
        }
    }

    // The depths of `count` rays, 0 where a line is not met before camera and projector. Lines are
    // sought where they would be without a lens, and `moved` on. That is renewed by the last pixel.
    void meet(int count, const float* x, const float* y, const float* place, const bool* known,
              float& moved, float* depths) const {
        float w[4], across[4], down[4], ahead[4], off[4], depth[4], wanted[4], found = 0.0f;
#pragma unroll
        for (int n = 0; n < 4 && n < count; ++n) {
            across[n] = pose[0] * x[n] + pose[1] * y[n] + pose[2];
            down[n] = pose[3] * x[n] + pose[4] * y[n] + pose[5];
            ahead[n] = pose[6] * x[n] + pose[7] * y[n] + pose[8];
            wanted[n] = (place[n] - lens[11 + AXIS]) * inverse[2 + AXIS];
            const float line = wanted[n] + moved;
            w[n] = __fdividef((AXIS ? down[n] : across[n]) - line * ahead[n],
                              line * pose[11] - pose[9 + AXIS]);
        }
        bool still = false;
        for (int step = 0; step < LENS_STEPS && !still; ++step) {
            still = true;
#pragma unroll
            for (int n = 0; n < 4 && n < count; ++n) {
                depth[n] = ahead[n] + w[n] * pose[11];
                const float over = __fdividef(1.0f, depth[n]);
                const float p = (across[n] + w[n] * pose[9]) * over;
                const float q = (down[n] + w[n] * pose[10]) * over;
                const float dp = (pose[9] - p * pose[11]) * over;
                const float dq = (pose[10] - q * pose[11]) * over;
                float u, v, xx, xy, yy;
                Light::bend(lens + 9, p, q, u, v, xx, xy, yy);
                off[n] = (AXIS ? v : u) - wanted[n];
                w[n] -= __fdividef(off[n], AXIS ? xy * dp + yy * dq : xx * dp + xy * dq);
                still = still & (!known[n] || fabsf(off[n]) < STILL);
                found = AXIS ? q : p;
            }
        }
        bool met = false;
#pragma unroll
        for (int n = 0; n < 4 && n < count; ++n) {
            met = known[n] && fabsf(off[n]) < NEAR && w[n] > 0.0f && depth[n] > 0.0f;
            const float z = __fdividef(1.0f, w[n]);
            depths[n] = met && z <= 3.4028235e38f ? z : 0.0f;
        }
        // Where it is not met, a neighbour begins without a lens.
        moved = met ? found - wanted[count - 1] : 0.0f;
    }
};
