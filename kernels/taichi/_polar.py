"""Length and angle of a gradient, shared by every Taichi family."""

import math

import taichi as ti

from cvkern.kernels.codes.filters import ATAN

from ._rounding import product, quotient

_HIGHEST, *_LOWER = reversed(ATAN)


@ti.func
def gradient_angle(dy: ti.f32, dx: ti.f32, zero: ti.i32) -> ti.f32:
    """Return atan2(dy, dx) in radians, by the polynomial in `codes.filters`."""
    ax = ti.abs(dx)
    ay = ti.abs(dy)
    a = 0.0
    if ti.max(ax, ay) > 0.0:
        a = quotient(ti.min(ax, ay), ti.max(ax, ay), zero)
    s = a * a
    r = ti.cast(_HIGHEST, ti.f32)
    for coefficient in ti.static(_LOWER):
        r = product(r, s, zero) + coefficient
    r = product(r, a, zero)
    if ay > ax:
        r = ti.cast(math.pi / 2.0, ti.f32) - r
    if dx < 0.0:
        r = ti.cast(math.pi, ti.f32) - r
    if dy < 0.0:
        r = -r
    return r


@ti.func
def squared_magnitude(dy: ti.f32, dx: ti.f32, zero: ti.i32) -> ti.f32:
    """Return dx^2 + dy^2, each square rounded."""
    return product(dx, dx, zero) + product(dy, dy, zero)
