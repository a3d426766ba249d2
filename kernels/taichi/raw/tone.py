"""Luminance and tone curves, in Taichi.

Reinhard's curve maps scaled luminance s to ``s (1 + s / w^2) / (1 + s)`` with the white w, or to
``s / (1 + a)`` with the mean a of the surroundings [Reinhard et al. 2002]. Colours are scaled as
luminance is. A negative value, and one that is not finite, becomes black. One thread takes a pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.raw import EDGE, LUMINANCE, UNSEEN
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient
from cvkern.kernels.taichi.raw._powers import exp2, log2
from cvkern.kernels.taichi.raw._sums import add_up

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
u8_1 = ti.types.ndarray(dtype=ti.u8, ndim=1)

RED, GREEN, BLUE = LUMINANCE


@ti.func
def _seen(v: ti.f32) -> ti.f32:
    return v if 0.0 < v < 3.4e38 else 0.0


@ti.func
def _light(red: ti.f32, green: ti.f32, blue: ti.f32, zero: ti.i32) -> ti.f32:
    sums = product(RED, _seen(red), zero) + product(GREEN, _seen(green), zero)
    return sums + product(BLUE, _seen(blue), zero)


@ti.kernel
def _luminance(radiance: f32_3, scale: ti.f32, zero: ti.i32, out: f32_2):
    for y, x in out:
        light = _seen(radiance[y, x, 0])
        if radiance.shape[2] == 3:
            light = _light(radiance[y, x, 0], radiance[y, x, 1], radiance[y, x, 2], zero)
        if scale > 0.0:
            out[y, x] = scale * light
        else:
            out[y, x] = log2(light, zero) if light > 1.2e-38 else UNSEEN


@primitive
def luminance(radiance: np.ndarray, scale: float, out: np.ndarray) -> None:
    """Write the luminance of (H, W, C) radiance times `scale`, or its log2 with a scale of 0.

    One thread a pixel.
    """
    _luminance(radiance, scale, 0, out)


@primitive
def survey(radiance: np.ndarray, logs: np.ndarray, sums: np.ndarray) -> None:
    """Write log2 of the luminance of (H, W, C) radiance, and measure it.

    Sums (SLOTS, 4) hold the sum of seen logarithms, in steps of 1 / STEPS, their number, and the
    largest of 2^32 less and of 2^32 more. One thread a pixel.
    """
    _luminance(radiance, 0.0, 0, logs)
    add_up(logs, sums)


@ti.kernel
def _limit(lowest: ti.f32, logs: f32_1):
    for i in logs:
        logs[i] = ti.max(logs[i], lowest)


@primitive
def limit(lowest: float, logs: np.ndarray) -> None:
    """Raise logarithms to the lowest; one thread a value."""
    _limit(lowest, logs)


@ti.kernel
def _show(
    radiance: f32_3,
    one: f32_2,
    own: ti.f32,
    two: f32_2,
    other: ti.f32,
    offset: ti.f32,
    zero: ti.i32,
    # outputs
    out: f32_3,
):
    for y, x in one:
        power = product(own, one[y, x], zero) + product(other, two[y, x], zero)
        ratio = exp2(power + offset, zero)
        for c in range(out.shape[2]):
            out[y, x, c] = ti.min(_seen(radiance[y, x, c]) * ratio, 1.0)


@primitive
def show(
    radiance: np.ndarray,
    one: np.ndarray,
    own: float,
    two: np.ndarray,
    other: float,
    offset: float,
    out: np.ndarray,
) -> None:
    """Multiply (H, W, C) radiance by 2 to a weighted sum of two images, and limit it to 1.

    One thread a pixel.
    """
    _show(radiance, one, own, two, other, offset, 0, out)


@ti.kernel
def _widen(
    centre: f32_1,
    wider: f32_1,
    level: ti.f32,
    begun: ti.i32,
    zero: ti.i32,
    found: f32_1,
    open: u8_1,
):
    for i in centre:
        c, w = centre[i], wider[i]
        flat = ti.abs(c - w) < product(EDGE, level + c, zero)
        if begun == 0:
            found[i] = c
        elif open[i] == 0:
            flat = False
        open[i] = ti.cast(flat, ti.u8)
        if flat:
            found[i] = w


@primitive
def widen(
    centre: np.ndarray,
    wider: np.ndarray,
    level: float,
    begun: int,
    found: np.ndarray,
    open: np.ndarray,
) -> None:
    """Take the mean of the next larger surroundings where none so far had an edge.

    One thread a pixel.
    """
    _widen(centre, wider, level, begun, 0, found, open)


@ti.kernel
def _curve(radiance: f32_2, around: f32_1, scale: ti.f32, white: ti.f32, zero: ti.i32, out: f32_2):
    for i in range(out.shape[0]):
        light = _seen(radiance[i, 0])
        if out.shape[1] == 3:
            light = _light(radiance[i, 0], radiance[i, 1], radiance[i, 2], zero)
        scaled = product(light, scale, zero)
        ratio = 0.0
        if white > 0.0:
            bent = 1.0 + quotient(scaled, white * white, zero)
            ratio = quotient(product(scale, bent, zero), 1.0 + scaled, zero)
        else:
            ratio = quotient(scale, 1.0 + around[i], zero)
        for c in range(out.shape[1]):
            out[i, c] = ti.min(_seen(radiance[i, c]) * ratio, 1.0)


@primitive
def curve(
    radiance: np.ndarray, around: np.ndarray, scale: float, white: float, out: np.ndarray
) -> None:
    """Apply Reinhard's curve to (N, C) radiance: with surroundings, or with a white above 0.

    One thread a pixel.
    """
    _curve(radiance, around, scale, white, 0, out)
