"""Fusion of exposures, in Taichi [Mertens, Kautz and Van Reeth 2007].

An image weighs at a pixel as the product of three measures: the size of the Laplacian of its mean
colour, the standard deviation of its colours, and ``exp(-(v - 1/2)^2 / (2 WELL^2))`` of each value
v. Each band of a Laplacian pyramid is the weighted mean of those of the images, with weights
smoothed as much as the level. The sum of the bands may leave 0 to 1 a little: values within KNEE of
either end, and beyond it, are bent by an exponential. One thread takes a pixel.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import taichi as ti

from cvkern.kernels.codes.raw import KNEE, LEAST
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient, root
from cvkern.kernels.taichi.raw._mirror import mirror
from cvkern.kernels.taichi.raw._powers import exp2, log2
from cvkern.kernels.taichi.raw._pyramid import enlarged
from cvkern.kernels.taichi.raw._pyramid import weigh as five

any_4 = ti.types.ndarray(ndim=4)  # u8 or f32
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)

STEEP = 1 / KNEE
THIRD = float(np.float32(1) / np.float32(3))


@ti.func
def _given(frames: ti.template(), k: ti.i32, y: ti.i32, x: ti.i32, c: ti.i32, scale: ti.f32):
    """Return a value as it is, floats limited to 0 to 1; NaN is 0."""
    value = ti.cast(frames[k, y, x, c], ti.f32)
    if scale == 1.0:
        value = ti.min(value, 1.0) if value > 0.0 else 0.0
    return value


@ti.func
def _value(
    frames: ti.template(), k: ti.i32, y: ti.i32, x: ti.i32, c: ti.i32, scale: ti.f32, zero: ti.i32
) -> ti.f32:
    return product(_given(frames, k, y, x, c, scale), scale, zero)


@ti.func
def _sum(frames: ti.template(), k: ti.i32, y: ti.i32, x: ti.i32, scale: ti.f32) -> ti.f32:
    """Return the sum of a pixel's values. That of bytes is exact: where edges cancel, 0 is left."""
    v, u = mirror(y, frames.shape[1]), mirror(x, frames.shape[2])
    found = _given(frames, k, v, u, 0, scale)
    if frames.shape[3] == 3:
        found += _given(frames, k, v, u, 1, scale)
        found += _given(frames, k, v, u, 2, scale)
    return found


@ti.func
def _power(x: ti.f32, p: ti.f32, zero: ti.i32) -> ti.f32:
    found = x
    if p == 0.0:
        found = 1.0
    elif p != 1.0:
        found = exp2(product(p, log2(ti.max(x, 1e-30), zero), zero), zero) if x > 1e-30 else 0.0
    return found


@ti.kernel
def _weigh(
    frames: any_4,
    scale: ti.f32,
    contrast: ti.f32,
    saturation: ti.f32,
    exposure: ti.f32,
    zero: ti.i32,
    # outputs
    weights: f32_3,
):
    for y, x in ti.ndrange(weights.shape[1], weights.shape[2]):
        total = 0.0
        for k in range(weights.shape[0]):
            own = _sum(frames, k, y, x, scale)
            down = _sum(frames, k, y - 1, x, scale) + _sum(frames, k, y + 1, x, scale)
            along = _sum(frames, k, y, x - 1, scale) + _sum(frames, k, y, x + 1, scale)
            share, mean = scale, own
            if frames.shape[3] == 3:
                # The quotient is exact where all are equal: grey has no saturation.
                share, mean = product(scale, THIRD, zero), quotient(own, 3.0, zero)
            here = product(mean, scale, zero)
            size = product(ti.abs((down + along) - 4.0 * own), share, zero)
            edge = _power(size, contrast, zero)
            far, spread = 0.0, 0.0
            for c in range(frames.shape[3]):
                v = _value(frames, k, y, x, c, scale, zero)
                far += product(v - 0.5, v - 0.5, zero)
                spread += product(v - here, v - here, zero)
            if frames.shape[3] == 3:
                deviation = root(product(spread, THIRD, zero), zero)
                edge = product(edge, _power(deviation, saturation, zero), zero)
            quality = product(edge, exp2(product(exposure, far, zero), zero), zero) + LEAST
            total += quality
            weights[k, y, x] = quality
        for k in range(weights.shape[0]):
            weights[k, y, x] = quotient(weights[k, y, x], total, zero)


@primitive
def weigh(
    frames: np.ndarray,
    scale: float,
    contrast: float,
    saturation: float,
    exposure: float,
    weights: np.ndarray,
) -> None:
    """Write the shares (K, H, W) of frames (K, H, W, C) at each pixel.

    `exposure` is times the square of a value's distance from 1/2, as a power of 2. One thread a
    pixel.
    """
    _weigh(frames, scale, contrast, saturation, exposure, 0, weights)


@ti.kernel
def _begin(frames: any_4, scale: ti.f32, weights: f32_3, zero: ti.i32, dst: f32_3):
    planes = frames.shape[3] + 1
    for j, y, x in ti.ndrange(frames.shape[0] * planes, dst.shape[1], dst.shape[2]):
        k, c = j // planes, j % planes
        line = ti.Vector([0.0, 0.0, 0.0, 0.0, 0.0])
        for t in ti.static(range(5)):
            u = mirror(2 * x + t - 2, frames.shape[2])
            column = ti.Vector([0.0, 0.0, 0.0, 0.0, 0.0])
            for r in ti.static(range(5)):
                v = mirror(2 * y + r - 2, frames.shape[1])
                if c < frames.shape[3]:
                    column[r] = _given(frames, k, v, u, c, scale)
                else:
                    column[r] = weights[k, v, u]
            line[t] = five(column[0], column[1], column[2], column[3], column[4], zero)
        found = five(line[0], line[1], line[2], line[3], line[4], zero)
        dst[j, y, x] = product(found, scale, zero) if c < frames.shape[3] else found


@primitive
def begin(frames: np.ndarray, scale: float, weights: np.ndarray, dst: np.ndarray) -> None:
    """Write the first smaller level of the channels and of the weights, K times C + 1 planes.

    C planes more are for the result. One thread a value.
    """
    _begin(frames, scale, weights, 0, dst)


@ti.kernel
def _blend(fine: f32_3, coarse: f32_3, channels: ti.i32, alone: ti.i32, zero: ti.i32):
    height, width = fine.shape[1], fine.shape[2]
    end = fine.shape[0] - channels
    for c, y, x in ti.ndrange(channels, height, width):
        total = 0.0
        if alone == 0:
            total = enlarged(coarse, end + c, height, width, y, x, zero)
        for k in range(end // (channels + 1)):
            plane = k * (channels + 1)
            band = fine[plane + c, y, x]
            if alone == 0:
                band -= enlarged(coarse, plane + c, height, width, y, x, zero)
            total += product(fine[plane + channels, y, x], band, zero)
        fine[end + c, y, x] = total


@primitive
def blend(levels: Sequence[np.ndarray], channels: int) -> None:
    """Add the weighted bands of each level to the result of the next smaller one, enlarged.

    Results are the last planes of a level, one for each channel. The smallest level is its own
    band. One thread a value.
    """
    _blend(levels[-1], levels[-1], channels, 1, 0)
    for coarse, fine in pairwise(levels[::-1]):
        _blend(fine, coarse, channels, 0, 0)


@ti.kernel
def _finish(
    frames: any_4,
    scale: ti.f32,
    weights: f32_3,
    coarse: f32_3,
    alone: ti.i32,
    zero: ti.i32,
    # outputs
    out: f32_3,
):
    for y, x, c in out:
        height, width = out.shape[0], out.shape[1]
        total = 0.0
        if alone == 0:
            below = frames.shape[0] * (out.shape[2] + 1) + c
            total = enlarged(coarse, below, height, width, y, x, zero)
        for k in range(frames.shape[0]):
            band = _value(frames, k, y, x, c, scale, zero)
            if alone == 0:
                plane = k * (out.shape[2] + 1) + c
                band -= enlarged(coarse, plane, height, width, y, x, zero)
            total += product(weights[k, y, x], band, zero)
        above = 1.0 - total
        power = product(STEEP, ti.min(total, above), zero) - 1.0
        if power < 0.0:
            bent = product(1 / STEEP, exp2(product(1.44269504, power, zero), zero), zero)
            total = bent if total < above else 1.0 - bent
        out[y, x, c] = total


@primitive
def finish(
    frames: np.ndarray,
    scale: float,
    weights: np.ndarray,
    coarse: np.ndarray,
    alone: int,
    out: np.ndarray,
) -> None:
    """Add the bands of the frames themselves, and bend values into 0 to 1: (H, W, C).

    Frames that stand `alone` have no smaller level. One thread a value.
    """
    _finish(frames, scale, weights, coarse, alone, 0, out)
