"""The lens of OpenCV: which ray is seen at a pixel.

A lens is the nine numbers fx, fy, cx, cy, k1, k2, p1, p2, k3. The equations stand in
cvkern/geometry/cameras/lens.py.
"""

import taichi as ti

vec2 = ti.types.vector(2, ti.f32)

NEWTON_STEPS = 5
WIDEST = 1.0e6  # largest tangent of the angle between a ray and the optical axis


@ti.func
def straightened(lenses: ti.template(), view: ti.i32, row: ti.f32, column: ti.f32) -> vec2:
    """Return the point, for f = 1, whose distorted image is at the pixel: Newton's method.

    If there is none, the result is arbitrary, but never so far away that a ray has no direction.
    """
    k1 = lenses[view, 4]
    k2 = lenses[view, 5]
    p1 = lenses[view, 6]
    p2 = lenses[view, 7]
    k3 = lenses[view, 8]
    want_x = (column - lenses[view, 2]) / lenses[view, 0]
    want_y = (row - lenses[view, 3]) / lenses[view, 1]
    x = want_x
    y = want_y
    if k1 != 0.0 or k2 != 0.0 or p1 != 0.0 or p2 != 0.0 or k3 != 0.0:
        for _ in range(NEWTON_STEPS):
            r2 = x * x + y * y
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))  # d radial / d x = slope x
            off_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - want_x
            off_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - want_y
            xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
            yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
            xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y  # the Jacobian is symmetric
            det = xx * yy - xy * xy
            x -= (yy * off_x - xy * off_y) / det
            y -= (xx * off_y - xy * off_x) / det
        if not (ti.abs(x) < WIDEST and ti.abs(y) < WIDEST):
            x, y = want_x, want_y
    return vec2(x, y)
