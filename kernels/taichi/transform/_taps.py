"""The place of a sample and the weights of its neighbours, as in scipy.ndimage, in Taichi.

The place q of a sample is first mapped into the image by the border's rule. A spline of order 0, 1
or 3 then weighs 1, 2 or 4 pixels along each axis by ``B(q - k)``, where B is the B-spline of that
order [M. Unser, IEEE Signal Processing Magazine 16(6), 1999]. Weights are in float64.
"""

import taichi as ti

from cvkern.kernels.codes.filters import Border
from cvkern.kernels.codes.transform import FARTHEST, OUTSIDE
from cvkern.kernels.taichi._borders import border_index
from cvkern.kernels.taichi._rounding import product, quotient, wide_product


@ti.func
def whole(q: ti.f64) -> ti.f64:
    """Round down."""
    return ti.floor(q, ti.f64)


@ti.func
def mapped(x: ti.f64, n: ti.i32, border: ti.i32, zero: ti.i32):
    """Map a coordinate as scipy.ndimage does; also return the derivative: 1, -1, or 0."""
    at = x
    slope = ti.cast(1.0, ti.f64)
    last = ti.cast(n - 1, ti.f64)
    size = ti.cast(n, ti.f64)
    if not (ti.abs(x) < FARTHEST):
        at = OUTSIDE
        slope = 0.0
    elif x < 0.0 or x > last:
        if border == Border.CONSTANT:
            at = OUTSIDE
            slope = 0.0
        elif border == Border.NEAREST:
            at = ti.max(ti.min(x, last), 0.0)
            slope = 0.0
        elif n == 1:
            at = 0.0
            slope = 0.0
        elif border == Border.WRAP:  # the first and the last pixel are one
            if x < 0.0:
                at = x + wide_product(last, whole(-x / last) + 1.0, zero)
            else:
                at = x - wide_product(last, whole(x / last), zero)
        elif border == Border.MIRROR:
            period = last + last
            if x < 0.0:
                y = wide_product(period, whole(-x / period), zero) + x
                at = y + period
                if y > -last:
                    at = -y
                    slope = -1.0
            else:
                at = x - wide_product(period, whole(x / period), zero)
                if at >= size:
                    at = period - at
                    slope = -1.0
        else:
            period = size + size
            if x < 0.0:
                y = x
                if x < -period:
                    y = wide_product(period, whole(-x / period), zero) + x
                at = y + period
                if y >= -size:
                    slope = -1.0
                    at = -y - 1.0
                    if y > -1e-15:
                        at = ti.cast(1e-15, ti.f64) - 1.0
            else:
                at = x - wide_product(period, whole(x / period), zero)
                if at >= size:
                    at = period - at - 1.0
                    slope = -1.0
    return at, slope


@ti.func
def tap_index(i: ti.i32, n: ti.i32, border: ti.i32) -> ti.i32:
    """Return the pixel that stands for pixel `i` of the spline: mirrored unless told otherwise."""
    rule = ti.cast(Border.MIRROR, ti.i32)
    if border == Border.REFLECT or border == Border.NEAREST:
        rule = border
    return border_index(i, n, rule)


@ti.func
def first_tap(x: ti.f64, order: ti.template()) -> ti.i32:
    """Return the first pixel that counts."""
    first = 0
    if ti.static(order == 0):
        first = ti.cast(whole(x + 0.5), ti.i32)
    elif ti.static(order == 1):
        first = ti.cast(whole(x), ti.i32)
    else:
        first = ti.cast(whole(x), ti.i32) - 1
    return first


@ti.func
def weights(x: ti.f64, order: ti.template(), zero: ti.i32):
    """Return the weights of the pixels from the first on."""
    f = ti.cast(x - whole(x), ti.f32)
    g = 1.0 - f
    found = ti.Vector([1.0, 0.0, 0.0, 0.0])
    if ti.static(order == 1):
        found = ti.Vector([g, f, 0.0, 0.0])
    elif ti.static(order == 3):
        f2 = product(f, f, zero)
        g2 = product(g, g, zero)
        f3 = product(f2, f, zero)
        g3 = product(g2, g, zero)
        middle = 4.0 - product(6.0, f2, zero) + product(3.0, f3, zero)
        second = 4.0 - product(6.0, g2, zero) + product(3.0, g3, zero)
        found = ti.Vector(
            [
                quotient(g3, 6.0, zero),
                quotient(middle, 6.0, zero),
                quotient(second, 6.0, zero),
                quotient(f3, 6.0, zero),
            ]
        )
    return found


@ti.func
def slopes(x: ti.f64, order: ti.template(), zero: ti.i32):
    """Return the derivatives of the weights."""
    f = ti.cast(x - whole(x), ti.f32)
    g = 1.0 - f
    found = ti.Vector([0.0, 0.0, 0.0, 0.0])
    if ti.static(order == 1):
        found = ti.Vector([-1.0, 1.0, 0.0, 0.0])
    elif ti.static(order == 3):
        f2 = product(f, f, zero)
        g2 = product(g, g, zero)
        found = ti.Vector(
            [
                product(-0.5, g2, zero),
                product(1.5, f2, zero) - 2.0 * f,
                2.0 * g - product(1.5, g2, zero),
                product(0.5, f2, zero),
            ]
        )
    return found


@ti.func
def sample(
    src: ti.template(),
    p: ti.i32,
    c: ti.i32,
    y: ti.f64,
    x: ti.f64,
    order: ti.template(),
    border: ti.i32,
    zero: ti.i32,
) -> ti.f32:
    """Weigh the pixels of one channel round a mapped coordinate."""
    down = weights(y, order, zero)
    along = weights(x, order, zero)
    top = first_tap(y, order)
    left = first_tap(x, order)
    total = ti.cast(zero, ti.f32)  # not a constant, which Taichi would leave out: 0 + -0 is 0
    if ti.static(order == 0):
        i = tap_index(top, src.shape[1], border)
        j = tap_index(left, src.shape[2], border)
        total = ti.cast(src[p, i, j, c], ti.f32)
    else:
        for a in ti.static(range(order + 1)):
            i = tap_index(top + a, src.shape[1], border)
            line = ti.cast(zero, ti.f32)
            for b in ti.static(range(order + 1)):
                j = tap_index(left + b, src.shape[2], border)
                line = line + product(along[b], ti.cast(src[p, i, j, c], ti.f32), zero)
            total = total + product(down[a], line, zero)
    return total


@ti.func
def stored(v: ti.f32) -> ti.f32:
    """Return a value as a byte: rounded and cut off, 0 for NaN."""
    held = 0.0
    if v > 0.0:
        held = ti.floor(ti.min(v, 255.0) + 0.5)
    return held
