"""Directions as integers: an angle has the same code on every device."""

import taichi as ti

from cvkern.kernels.codes.hough import DIRECTION_FACTOR, DIRECTIONS
from cvkern.kernels.taichi._rounding import product


@ti.func
def direction_code(angle: ti.f32, zero: ti.i32) -> ti.i32:
    """Return the nearest of DIRECTIONS codes over the full turn."""
    turned = product(angle, DIRECTION_FACTOR, zero) + 0.5
    return ti.cast(ti.floor(turned), ti.i32) & (DIRECTIONS - 1)
