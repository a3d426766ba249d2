"""Orientation of a gradient from sums, products and one quotient: equal bits on every device."""

import math

import warp as wp

from cvkern.kernels.codes.filters import ATAN

_ATAN = tuple(wp.constant(c) for c in ATAN)
A0, A1, A2, A3, A4, A5, A6, A7 = _ATAN
PI = wp.constant(math.pi)
HALF_PI = wp.constant(math.pi / 2.0)


@wp.func
def atan2(y: float, x: float) -> float:
    """Return the angle of (x, y) in (-pi, pi], within 2e-7; 0 for the zero vector."""
    ax = wp.abs(x)
    ay = wp.abs(y)
    high = wp.max(ax, ay)
    a = wp.where(high > 0.0, wp.min(ax, ay) / high, 0.0)
    s = a * a
    p = ((((((A7 * s + A6) * s + A5) * s + A4) * s + A3) * s + A2) * s + A1) * s + A0
    r = p * a
    r = wp.where(ay > ax, HALF_PI - r, r)
    r = wp.where(x < 0.0, PI - r, r)
    return wp.where(y < 0.0, r * -1.0, r)  # Warp takes -r from 0, which would lose the sign of 0
