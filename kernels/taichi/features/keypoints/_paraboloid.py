"""The fit of a paraboloid to an extremum, in Taichi; refinement.py has the equations."""

import taichi as ti

from cvkern.kernels.codes.features import MOVES
from cvkern.kernels.taichi._rounding import wide_product


@ti.func
def _difference(levels: ti.template(), s: ti.i32, y: ti.i32, x: ti.i32) -> ti.f64:
    """Return the difference of two neighbouring levels."""
    return ti.cast(levels[s + 1, y, x] - levels[s, y, x], ti.f64)


@ti.func
def _minor(a: ti.f64, b: ti.f64, c: ti.f64, d: ti.f64, zero: ti.i32) -> ti.f64:
    """Return a b - c d."""
    return wide_product(a, b, zero) - wide_product(c, d, zero)


@ti.func
def _dot(a: ti.f64, b: ti.f64, c: ti.f64, x: ti.f64, y: ti.f64, z: ti.f64, zero: ti.i32) -> ti.f64:
    """Return a x + b y + c z."""
    return wide_product(a, x, zero) + wide_product(b, y, zero) + wide_product(c, z, zero)


@ti.dataclass
class Fit:
    """Where a fit ends, and whether it is kept."""

    kept: ti.i32
    s: ti.i32
    y: ti.i32
    x: ti.i32
    oy: ti.f64
    ox: ti.f64
    os: ti.f64
    top: ti.f64


@ti.func
def fit(
    levels: ti.template(),
    s0: ti.i32,
    y0: ti.i32,
    x0: ti.i32,
    contrast: ti.f32,
    edge: ti.f32,
    margin: ti.i32,
    zero: ti.i32,
):
    """Fit a paraboloid to an extremum, and move it to where that has its own."""
    height = levels.shape[1]
    width = levels.shape[2]
    s = s0
    y = y0
    x = x0
    kept = 0
    oy = ti.cast(0.0, ti.f64)
    ox = ti.cast(0.0, ti.f64)
    os = ti.cast(0.0, ti.f64)
    top = ti.cast(0.0, ti.f64)
    for _ in range(MOVES):
        c = _difference(levels, s, y, x)
        u = _difference(levels, s, y - 1, x)
        d = _difference(levels, s, y + 1, x)
        l = _difference(levels, s, y, x - 1)
        r = _difference(levels, s, y, x + 1)
        b = _difference(levels, s - 1, y, x)
        a = _difference(levels, s + 1, y, x)
        gy = 0.5 * (d - u)
        gx = 0.5 * (r - l)
        gs = 0.5 * (a - b)
        yy = d + u - c - c
        xx = r + l - c - c
        ss = a + b - c - c
        xy = 0.25 * (
            _difference(levels, s, y + 1, x + 1)
            - _difference(levels, s, y + 1, x - 1)
            - _difference(levels, s, y - 1, x + 1)
            + _difference(levels, s, y - 1, x - 1)
        )
        xs = 0.25 * (
            _difference(levels, s + 1, y, x + 1)
            - _difference(levels, s + 1, y, x - 1)
            - _difference(levels, s - 1, y, x + 1)
            + _difference(levels, s - 1, y, x - 1)
        )
        ys = 0.25 * (
            _difference(levels, s + 1, y + 1, x)
            - _difference(levels, s + 1, y - 1, x)
            - _difference(levels, s - 1, y + 1, x)
            + _difference(levels, s - 1, y - 1, x)
        )
        # The inverse by cofactors.
        m00 = _minor(yy, ss, ys, ys, zero)
        m01 = _minor(xs, ys, xy, ss, zero)
        m02 = _minor(xy, ys, xs, yy, zero)
        det = _dot(xx, xy, xs, m00, m01, m02, zero)
        if det == 0.0:
            break
        m11 = _minor(xx, ss, xs, xs, zero)
        m12 = _minor(xy, xs, xx, ys, zero)
        m22 = _minor(xx, yy, xy, xy, zero)
        ox = -(_dot(m00, m01, m02, gx, gy, gs, zero) / det)
        oy = -(_dot(m01, m11, m12, gx, gy, gs, zero) / det)
        os = -(_dot(m02, m12, m22, gx, gy, gs, zero) / det)
        if ti.abs(ox) < 0.5 and ti.abs(oy) < 0.5 and ti.abs(os) < 0.5:
            top = c + 0.5 * _dot(gx, gy, gs, ox, oy, os, zero)
            trace = xx + yy
            # This is tr^2 / det < edge, for a positive det.
            if ti.abs(top) >= ti.cast(contrast, ti.f64) and m22 > 0.0:
                squared = wide_product(trace, trace, zero)
                if squared < wide_product(ti.cast(edge, ti.f64), m22, zero):
                    kept = 1
            break
        # Beyond two pixels the fit means nothing.
        if not (ti.abs(ox) < 3.0 and ti.abs(oy) < 3.0 and ti.abs(os) < 3.0):
            break
        x += ti.cast(ti.floor(ox + 0.5), ti.i32)
        y += ti.cast(ti.floor(oy + 0.5), ti.i32)
        s += ti.cast(ti.floor(os + 0.5), ti.i32)
        if s < 1 or s > levels.shape[0] - 3:
            break
        if y < margin or y >= height - margin or x < margin or x >= width - margin:
            break
    return Fit(kept=kept, s=s, y=y, x=x, oy=oy, ox=ox, os=os, top=ti.abs(top))
