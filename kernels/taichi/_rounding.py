"""Float32 arithmetic that rounds as IEEE 754 says, on every device.

On CUDA, Taichi 1.7 marks all its code "unsafe-fp-math", whatever its option `fast_math` says: a
product that is added to becomes a fused multiply-add, and division and square root become
approximations. What is not here (sums, lone products, comparisons) is IEEE everywhere, but that
Taichi takes numbers below 1.2e-38 for zero. The argument `zero` is always 0.
"""

import taichi as ti


@ti.func
def product(a: ti.f32, b: ti.f32, zero: ti.i32) -> ti.f32:
    """Return a b, rounded before it is added to anything."""
    return _hidden(a * b, zero)


@ti.func
def wide_product(a: ti.f64, b: ti.f64, zero: ti.i32) -> ti.f64:
    """Return a b, rounded before it is added to anything."""
    return ti.bit_cast(ti.bit_cast(a * b, ti.i64) ^ ti.cast(zero, ti.i64), ti.f64)


@ti.func
def quotient(a: ti.f32, b: ti.f32, zero: ti.i32) -> ti.f32:
    """Return a / b: float64 has 53 >= 2 * 24 + 2 digits, so rounding its quotient is exact."""
    wide = ti.cast(a, ti.f64) / ti.cast(b, ti.f64)
    # Hidden as well, or the compiler divides in float32.
    return ti.cast(ti.bit_cast(ti.bit_cast(wide, ti.i64) ^ ti.cast(zero, ti.i64), ti.f64), ti.f32)


@ti.func
def root(x: ti.f32, zero: ti.i32) -> ti.f32:
    """Return the square root of x >= 0.

    Two steps of Heron's rule in float64 take any estimate within 1e-6 to 1.7e-16. No root of a
    float32 is that close to where rounding changes: |x - m^2| >= 2^-48 for a midpoint m in [1, 2)
    of 25 digits, so |sqrt(x) - m| >= 2^-50.
    """
    estimate = _hidden(
        ti.sqrt(x), zero
    )  # otherwise a quotient by it becomes an inverse square root
    if 0.0 < estimate < ti.math.inf:
        wide = ti.cast(x, ti.f64)
        y = ti.cast(estimate, ti.f64)
        for _ in ti.static(range(2)):
            y = 0.5 * (y + wide / y)
        estimate = ti.cast(y, ti.f32)
    return estimate


@ti.func
def _hidden(value: ti.f32, zero: ti.i32) -> ti.f32:
    """Return `value`; the compiler, not knowing that `zero` is 0, cannot see where it is from."""
    return ti.bit_cast(ti.bit_cast(value, ti.i32) ^ zero, ti.f32)
