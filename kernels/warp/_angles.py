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
    """Angle of (x, y) in (-pi, pi], within 2e-7; 0 for the zero vector."""
    ax = wp.abs(x)
    ay = wp.abs(y)
    high = wp.max(ax, ay)
    a = wp.where(high > 0.0, wp.min(ax, ay) / high, 0.0)
    s = a * a
    p = ((((((A7 * s + A6) * s + A5) * s + A4) * s + A3) * s + A2) * s + A1) * s + A0
    r = p * a
    r = wp.where(ay > ax, HALF_PI - r, r)
    r = wp.where(x < 0.0, PI - r, r)
    return wp.where(y < 0.0, -r, r)


# The same for a whole row of the CPU, in C, which becomes vector code as it stands.
_POLAR_ROW = """
    #pragma clang fp contract(off)
    const size_t first = (size_t)row * dy.shape[1];
    const float* y = dy.data + first;
    const float* x = dx.data + first;
    float* __restrict__ length = magnitude.data + first;
    float* __restrict__ angle = orientation.data + first;
    #pragma clang loop vectorize(assume_safety)
    for (int i = 0; i < dy.shape[1]; ++i) {
        const float ax = __builtin_fabsf(x[i]), ay = __builtin_fabsf(y[i]);
        const float high = ax < ay ? ay : ax, low = ax < ay ? ax : ay;
        const float a = high > 0.0f ? low / (high > 0.0f ? high : 1.0f) : 0.0f;
        const float s = a * a;
        float p = A7;
        p = p * s + A6; p = p * s + A5; p = p * s + A4; p = p * s + A3;
        p = p * s + A2; p = p * s + A1; p = p * s + A0;
        float r = p * a;
        r = ay > ax ? HALF_PI - r : r;
        r = x[i] < 0.0f ? PI - r : r;
        angle[i] = y[i] < 0.0f ? -r : r;
        length[i] = wp::sqrt(x[i] * x[i] + y[i] * y[i]);
    }
"""
_VALUES = {"HALF_PI": math.pi / 2.0, "PI": math.pi} | {f"A{i}": c for i, c in enumerate(ATAN)}
for _name, _value in _VALUES.items():
    _POLAR_ROW = _POLAR_ROW.replace(_name, f"{_value!r}f")


@wp.func_native(_POLAR_ROW)
def polar_row(
    row: int,
    dy: wp.array2d[float],
    dx: wp.array2d[float],
    magnitude: wp.array2d[float],
    orientation: wp.array2d[float],
): ...
