"""Float32 arithmetic with IEEE 754 rounding on every device.

On CUDA, Taichi 1.7 marks all its code "unsafe-fp-math", even without its option `fast_math`. Then a
product followed by a sum becomes a fused multiply-add, and division and square root become
approximations. In a loop, a division by what the loop does not change becomes a product by the
reciprocal, in float64 too: such code takes the reciprocal itself, in both kernel sets. Other
operations (sums, single products, comparisons) follow IEEE everywhere, except that Taichi treats
numbers below 1.2e-38 as zero where `_denormals.py` does not prevent that. The argument `zero` is
always 0.
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
    """Return a / b: float64 has 53 >= 2 * 24 + 2 bits, so its rounded quotient is correct."""
    wide = ti.cast(a, ti.f64) / ti.cast(b, ti.f64)
    # Hide the value as well, or the compiler divides in float32.
    return ti.cast(ti.bit_cast(ti.bit_cast(wide, ti.i64) ^ ti.cast(zero, ti.i64), ti.f64), ti.f32)


@ti.func
def root(x: ti.f32, zero: ti.i32) -> ti.f32:
    """Return the square root of x >= 0.

    Two steps of Heron's rule in float64 reduce a relative error of 1e-6 to 1.7e-16. No root of a
    float32 is that close to a point where the rounding changes: a midpoint m in [1, 2) has 25 bits,
    so |x - m^2| >= 2^-48, and |sqrt(x) - m| >= 2^-50.
    """
    estimate = _hidden(
        ti.sqrt(x), zero
    )  # otherwise the compiler turns a division by this root into an inverse square root
    if 0.0 < estimate < ti.math.inf:
        wide = ti.cast(x, ti.f64)
        y = ti.cast(estimate, ti.f64)
        for _ in ti.static(range(2)):
            y = 0.5 * (y + wide / y)
        estimate = ti.cast(y, ti.f32)
    return estimate


@ti.func
def _hidden(value: ti.f32, zero: ti.i32) -> ti.f32:
    """Return `value`, hidden from the optimiser, which does not know that `zero` is 0."""
    return ti.bit_cast(ti.bit_cast(value, ti.i32) ^ zero, ti.f32)
