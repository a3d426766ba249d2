"""Curves and matrices of colour spaces, in Taichi.

sRGB [IEC 61966-2-1]: ``12.92 v`` up to 0.0031308, and ``1.055 v^(1/2.4) - 0.055`` above. L*a*b*
[CIE 15]: with ``f(t) = t^(1/3)``, below (6/29)^3 its tangent, of X, Y and Z over those of white,
``L = 116 f(Y) - 16``, ``a = 500 (f(X) - f(Y))``, ``b = 200 (f(Y) - f(Z))``; LCh are its polar
coordinates. Powers agree between devices to rounding.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.color import (
    DARKEST,
    DEGREES,
    FIRST,
    LAB_LOW,
    LAB_SHIFT,
    LAB_SLOPE,
    SRGB_LOW,
    SRGB_POWER,
    SRGB_SCALE,
    SRGB_SHIFT,
    SRGB_SLOPE,
    Form,
)
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
vec3 = ti.types.vector(3, ti.f32)

SRGB, LAB, LCH = int(Form.SRGB), int(Form.LAB), int(Form.LCH)


@ti.func
def _linear(v: ti.f32) -> ti.f32:
    result = v / SRGB_SLOPE
    if v > SRGB_LOW * SRGB_SLOPE:
        result = ti.pow((v + SRGB_SHIFT) / SRGB_SCALE, SRGB_POWER)
    return result


@ti.func
def _curved(v: ti.f32) -> ti.f32:
    result = v * SRGB_SLOPE
    if v > SRGB_LOW:
        result = SRGB_SCALE * ti.pow(v, 1 / SRGB_POWER) - SRGB_SHIFT
    return result


@ti.func
def _cubed(f: ti.f32) -> ti.f32:
    result = (f - LAB_SHIFT) / LAB_SLOPE
    if f > LAB_LOW ** (1 / 3):
        result = f * f * f
    return result


@ti.func
def _rooted(t: ti.f32) -> ti.f32:
    result = LAB_SLOPE * t + LAB_SHIFT
    if t > LAB_LOW:
        result = ti.pow(t, 1 / 3)
    return result


@ti.func
def _mixed(colours: f32_2, i: ti.i32, source: ti.i32, numbers: f32_1, zero: ti.i32) -> vec3:
    """Undo the curve of a colour and multiply it by the matrix."""
    v = vec3(0.0)
    for k in ti.static(range(3)):
        v[k] = product(colours[i, k], numbers[9], zero)
    if source == SRGB:
        v = vec3(_linear(v[0]), _linear(v[1]), _linear(v[2]))
    if source >= LAB:
        a, b = v[1], v[2]
        if source == LCH:
            a = v[1] * ti.cos(v[2] / DEGREES)
            b = v[1] * ti.sin(v[2] / DEGREES)
        f = (v[0] + 16.0) / 116.0
        v = vec3(_cubed(f + a / 500.0), _cubed(f), _cubed(f - b / 200.0))
    found = vec3(0.0)
    for k in ti.static(range(3)):
        found[k] = (
            product(numbers[3 * k], v[0], zero) + product(numbers[3 * k + 1], v[1], zero)
        ) + product(numbers[3 * k + 2], v[2], zero)
    return found


@ti.kernel
def _convert(
    colours: f32_2, source: ti.i32, target: ti.i32, numbers: f32_1, zero: ti.i32, out: f32_2
):
    for i in range(out.shape[0]):
        v = _mixed(colours, i, source, numbers, zero)
        if target == SRGB:
            v = vec3(_curved(v[0]), _curved(v[1]), _curved(v[2]))
        if target >= LAB:
            x, y, z = _rooted(v[0]), _rooted(v[1]), _rooted(v[2])
            a = 500.0 * (x - y)
            b = 200.0 * (y - z)
            v = vec3(116.0 * y - 16.0, a, b)
            if target == LCH:
                hue = ti.atan2(b, a) * DEGREES
                v[1] = ti.sqrt(a * a + b * b)
                v[2] = hue + 360.0 if hue < 0.0 else hue
        for k in ti.static(range(3)):
            out[i, k] = v[k]


@primitive
def convert(
    colours: np.ndarray, source: int, target: int, numbers: np.ndarray, out: np.ndarray
) -> None:
    """Undo the source's curve, multiply by the matrix, and apply the target's curve.

    `numbers` are the matrix, row by row, and what values are multiplied by first; one thread a
    pixel.
    """
    _convert(colours, source, target, numbers, 0, out)


@ti.kernel
def _encode(
    colours: f32_2,
    source: ti.i32,
    numbers: f32_1,
    steps: i32_1,
    zero: ti.i32,
    # outputs
    out: u8_2,
):
    for i in range(out.shape[0]):
        v = _mixed(colours, i, source, numbers, zero)
        for k in ti.static(range(3)):
            bits = ti.bit_cast(ti.min(v[k], 1.0) if v[k] > DARKEST else DARKEST, ti.i32)
            out[i, k] = ti.cast((steps[(bits >> 16) - FIRST] + (bits & 0xFFFF)) >> 16, ti.u8)


@primitive
def encode(
    colours: np.ndarray, source: int, numbers: np.ndarray, steps: np.ndarray, out: np.ndarray
) -> None:
    """Do the same to sRGB of 8 bits, with a table of its steps up; one thread a pixel.

    The upper half of a value's bits chooses a number, to which the lower half is added. The upper
    half of the sum is the code.
    """
    _encode(colours, source, numbers, steps, 0, out)
