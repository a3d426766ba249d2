"""The lens of OpenCV: which ray is seen at a pixel.

A lens is the nine numbers fx, fy, cx, cy, k1, k2, p1, p2, k3. The equations stand in
cvkern/geometry/cameras/lens.py.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

NEWTON_STEPS = wp.constant(5)
WIDEST = wp.constant(1.0e6)  # largest tangent of the angle between a ray and the optical axis


@wp.func
def straightened(lenses: wp.array2d[float], view: int, row: float, column: float) -> wp.vec2:
    """Return the point, for f = 1, whose distorted image is at the pixel: Newton's method.

    If there is none, the result is arbitrary, but never so far away that a ray has no direction.
    """
    k1 = lenses[view, 4]
    k2 = lenses[view, 5]
    p1 = lenses[view, 6]
    p2 = lenses[view, 7]
    k3 = lenses[view, 8]
    want = wp.vec2(
        (column - lenses[view, 2]) / lenses[view, 0], (row - lenses[view, 3]) / lenses[view, 1]
    )
    found = want
    if wp.abs(k1) + wp.abs(k2) + wp.abs(p1) + wp.abs(p2) + wp.abs(k3) > 0.0:
        for _ in range(NEWTON_STEPS):
            x = found[0]
            y = found[1]
            r2 = x * x + y * y
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))  # d radial / d x = slope x
            off = wp.vec2(
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - want[0],
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - want[1],
            )
            xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
            yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
            xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y  # the Jacobian is symmetric
            det = xx * yy - xy * xy
            found -= wp.vec2(yy * off[0] - xy * off[1], xx * off[1] - xy * off[0]) / det
        if not (wp.abs(found[0]) < WIDEST and wp.abs(found[1]) < WIDEST):
            found = want
    return found
