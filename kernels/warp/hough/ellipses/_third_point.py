"""What a third point says about an ellipse whose major axis is known, in C for either device."""

# With 2 a the axis from (row[i], column[i]) to (row[j], column[j]), whose difference is e, and
# 2 p the third point's place from the centre, P = 2 p . e and Q = 2 p x e are 4 a times its
# coordinates along the axes. From x^2 / a^2 + y^2 / b^2 = 1 the square of the minor semi-axis is
#     b^2 = (4 a^2) Q^2 / (4 (4 a^2 - P) (4 a^2 + P)),
# which is the formula of Xie and Ji without its angle. The normal there is b^2 P e + a^2 Q e', with
# e' square to e. Only sums of two products are rounded twice: the same on every device.
THIRD = """
    const float py = y + y - my, px = x + x - mx;
    const float p = py * ey + px * ex, q = py * ex - px * ey;
    const float behind = whole - p, ahead = whole + p;
    const bool inside = (behind > 0.0f) & (ahead > 0.0f) & (py * py + px * px <= whole);
    const float divisor = inside ? behind * ahead : 1.0f;
    const float square = q * q * (0.25f * whole) / divisor;
    const float u = square * p, v = 0.25f * whole * q;
    const float gy = u * ey + v * ex, gx = u * ex - v * ey;
    const float cross = ny * gx - nx * gy;
    const bool aligned = !directed | (cross * cross <= turn * (gy * gy + gx * gx));
    const bool counts = inside & (square >= narrow) & (square <= wide) & aligned;
"""
