"""Merging of exposures in Taichi.

The response g(z) is log2 of the exposure that gives the value z. With exposure times t, the log2 of
radiance is the weighted mean of ``g(z) - log2 t`` over the exposures [Debevec and Malik 1997]. For
linear values v, radiance is the mean of ``v / t`` with weights t^2. Where the reference counts, an
exposure that differs from it by more than some stops has no weight. One thread takes a pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.raw import FADE, FAINTEST, MIDDLE
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient

any_3 = ti.types.ndarray(ndim=3)  # u8, u16 or f32
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
vec3 = ti.types.vector(3, ti.f32)


@ti.func
def _told(
    frames: any_3,
    tables: f32_3,
    times: f32_2,
    k: ti.i32,
    i: ti.i32,
    c: ti.i32,
    most: ti.f32,
    zero: ti.i32,
) -> vec3:
    """Return the weight of an exposure at a pixel, its light, and the light to compare.

    The light is linear if `most` is above 0, and log2 otherwise, as the table of the response has.
    """
    found = vec3(0.0)
    if most > 0.0:
        value = ti.cast(frames[k, i, c], ti.f32)
        near = quotient(product(most - value, FADE, zero), most, zero)
        squared = product(ti.math.clamp(near, 0.0, 1.0), times[k, 0], zero)
        light = quotient(value, times[k, 0], zero)
        found = vec3(product(squared, times[k, 0], zero), light, ti.max(light, FAINTEST))
    else:
        code = ti.cast(frames[k, i, c], ti.i32)
        light = tables[code, c, 0] - times[k, 1]
        found = vec3(tables[code, c, 1], light, light)
    return found


@ti.func
def _apart(a: ti.f32, b: ti.f32, stops: ti.f32, most: ti.f32) -> ti.i32:
    """Tell whether two lights differ by more than some stops: a factor, if they are linear."""
    found = ti.abs(a - b) > stops
    if most > 0.0:
        found = a > b * stops or b > a * stops
    return ti.cast(found, ti.i32)


@ti.kernel
def _merge(
    frames: any_3,  # (K, N, C)
    tables: f32_3,  # (256, C, 2)
    times: f32_2,
    order: i32_1,
    reference: ti.i32,
    stops: ti.f32,
    most: ti.f32,
    zero: ti.i32,
    # outputs
    radiance: f32_2,
):
    for i, c in radiance:
        told = _told(frames, tables, times, reference, i, c, most, zero)
        known = stops > 0.0 and told[0] > 0.0
        compared = told[2]
        weights = told[0]
        total = product(told[0], told[1], zero)
        for n in range(frames.shape[0]):
            k = order[n]
            if k != reference:
                told = _told(frames, tables, times, k, i, c, most, zero)
                if not (known and _apart(told[2], compared, stops, most) == 1):
                    weights += told[0]
                    total += product(told[0], told[1], zero)
        found = quotient(total, ti.max(weights, FAINTEST), zero)
        if not weights > 0.0:
            k = order[0]
            if most <= 0.0 and ti.cast(frames[k, i, c], ti.i32) < MIDDLE:
                k = order[frames.shape[0] - 1]
            found = _told(frames, tables, times, k, i, c, most, zero)[1]
        if most <= 0.0:
            found = ti.pow(2.0, found)
        radiance[i, c] = found


@primitive
def merge(
    frames: np.ndarray,
    tables: np.ndarray,
    times: np.ndarray,
    order: np.ndarray,
    reference: int,
    stops: float,
    most: float,
    radiance: np.ndarray,
) -> None:
    """Merge (K, N, C) values; `order` has the exposures from the shortest to the longest.

    `tables` (256, C, 2) has log2 exposures and weights of values, unless `most` is above 0: then
    values are linear, and saturated there, and `stops` is a factor. `times` (K, 2) has seconds and
    their log2. One thread a value.
    """
    _merge(frames, tables, times, order, reference, stops, most, 0, radiance)
