"""Logarithms and powers of 2, of the same bits on every device: sums and products in this order."""

import taichi as ti

from cvkern.kernels.taichi._rounding import product, quotient


@ti.func
def log2(x: ti.f32, zero: ti.i32) -> ti.f32:
    """Return the logarithm of x > 0, normal.

    That is ``2 / ln 2 (s + s^3 / 3 + ...)`` with ``s = f / (2 + f)`` and ``x = 2^n (1 + f)``.
    """
    bits = ti.bit_cast(x, ti.i32)
    n = (bits - 0x3F3504F3) >> 23
    f = ti.bit_cast(bits - (n << 23), ti.f32) - 1.0
    s = quotient(f, 2.0 + f, zero)
    z = product(s, s, zero)
    high = 0.412198583 + product(z, 0.320598898, zero)
    low = 0.961796694 + product(z, 0.577078016 + product(z, high, zero), zero)
    return ti.cast(n, ti.f32) + product(s, 2.885390082 + product(z, low, zero), zero)


@ti.func
def exp2(x: ti.f32, zero: ti.i32) -> ti.f32:
    """Return 2^x, with x limited to where that is normal: Taylor's series about an integer."""
    y = ti.max(ti.min(x, 127.0), -126.0)
    n = ti.cast(y + (-0.5 if y < 0.0 else 0.5), ti.i32)
    f = y - ti.cast(n, ti.f32)
    high = 0.00961812911 + product(f, 0.00133335581 + product(f, 0.000154035304, zero), zero)
    low = 0.240226507 + product(f, 0.0555041087 + product(f, high, zero), zero)
    series = 1.0 + product(f, 0.693147181 + product(f, low, zero), zero)
    return product(ti.bit_cast((n + 127) << 23, ti.f32), series, zero)
