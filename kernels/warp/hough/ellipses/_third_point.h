// The minor semi-axis of an ellipse from its major axis and a third point, for both devices.
//
// Let e be the difference of the two end points, 2 a its length, and 2 p twice the third point's
// position relative to the centre. P = 2 p . e and Q = 2 p x e are 4 a times its coordinates along
// the axes. From x^2 / a^2 + y^2 / b^2 = 1 the square of the minor semi-axis is
//     b^2 = (4 a^2) Q^2 / (4 (4 a^2 - P) (4 a^2 + P)).
// This is the formula of Xie and Ji (ICPR 2002) without its angle. The normal at the third point is
// b^2 P e + a^2 Q e', with e' normal to e. Products are rounded before they are added, so the
// results are the same on every device.
struct Axis {
    float ey, ex, my, mx, whole;  // the difference, the sum and the squared distance of the two

    CUDA_CALLABLE Axis(const float* row, const float* column, int i, int j) {
#pragma clang fp contract(off)
        ey = row[j] - row[i], ex = column[j] - column[i];
        my = row[j] + row[i], mx = column[j] + column[i];
        whole = ey * ey + ex * ex;
    }

    // Tell whether a direction is that of (gy, gx), or its opposite; `turn` is the squared sine of
    // the tolerance.
    static CUDA_CALLABLE bool aligned(float ny, float nx, float gy, float gx, float square,
                                      float turn) {
#pragma clang fp contract(off)
        const float cross = ny * gx - nx * gy;
        return cross * cross <= turn * square;
    }

    // Return the square of the minor semi-axis, or -1 for a point that does not vote.
    CUDA_CALLABLE float minor(float y, float x, float ny, float nx, float narrow, float wide,
                              bool directed, float turn) const {
#pragma clang fp contract(off)
        const float py = y + y - my, px = x + x - mx;
        const float p = py * ey + px * ex, q = py * ex - px * ey;
        const float behind = whole - p, ahead = whole + p;
        const bool inside = (behind > 0.0f) & (ahead > 0.0f) & (py * py + px * px <= whole);
        const float divisor = inside ? behind * ahead : 1.0f;
        const float square = q * q * (0.25f * whole) / divisor;
        const float u = square * p, v = 0.25f * whole * q;
        const float gy = u * ey + v * ex, gx = u * ex - v * ey;
        const bool along = !directed | aligned(ny, nx, gy, gx, gy * gy + gx * gx, turn);
        return (inside & (square >= narrow) & (square <= wide) & along) ? square : -1.0f;
    }
};
