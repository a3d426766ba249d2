"""Bands of a local Laplacian filter, in Taichi [Paris et al. 2011, Aubry et al. 2014].

About a reference g, values are remapped to ``g + n + slope (d - n)``, with ``d = v - g`` and n the
part of d within sigma: details stay, edges shrink. Pyramids of the image remapped about evenly
spaced references give the bands of the result: a pixel whose smoothed value lies between two
references has the bands of both, each weighted by how near its reference is. Planes of a level are
these, the image's own, and the result. One thread takes a pixel.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient
from cvkern.kernels.taichi.raw._mirror import mirror
from cvkern.kernels.taichi.raw._pyramid import enlarged, weigh

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)


@ti.func
def _remapped(v: ti.f32, about: ti.f32, sigma: ti.f32, slope: ti.f32, zero: ti.i32) -> ti.f32:
    d = v - about
    near = ti.math.clamp(d, -sigma, sigma)
    return (about + near) + product(slope, d - near, zero)


@ti.kernel
def _begin(
    logs: f32_2,
    lowest: ti.f32,
    step: ti.f32,
    sigma: ti.f32,
    slope: ti.f32,
    zero: ti.i32,
    # outputs
    dst: f32_3,
):
    for j, y, x in ti.ndrange(dst.shape[0] - 1, dst.shape[1], dst.shape[2]):
        about = lowest + product(ti.cast(j, ti.f32), step, zero)
        line = ti.Vector([0.0, 0.0, 0.0, 0.0, 0.0])
        for t in ti.static(range(5)):
            u = mirror(2 * x + t - 2, logs.shape[1])
            column = ti.Vector([0.0, 0.0, 0.0, 0.0, 0.0])
            for k in ti.static(range(5)):
                value = logs[mirror(2 * y + k - 2, logs.shape[0]), u]
                if j < dst.shape[0] - 2:
                    value = _remapped(value, about, sigma, slope, zero)
                column[k] = value
            line[t] = weigh(column[0], column[1], column[2], column[3], column[4], zero)
        dst[j, y, x] = weigh(line[0], line[1], line[2], line[3], line[4], zero)


@primitive
def begin(
    logs: np.ndarray, lowest: float, step: float, sigma: float, slope: float, dst: np.ndarray
) -> None:
    """Write the first smaller level of the image remapped about each reference, and of its own.

    One thread a value.
    """
    _begin(logs, lowest, step, sigma, slope, 0, dst)


@ti.kernel
def _reduce(src: f32_3, planes: ti.i32, zero: ti.i32, dst: f32_3):
    for j, y, x in ti.ndrange(planes, dst.shape[1], dst.shape[2]):
        line = ti.Vector([0.0, 0.0, 0.0, 0.0, 0.0])
        for t in ti.static(range(5)):
            u = mirror(2 * x + t - 2, src.shape[2])
            column = ti.Vector([0.0, 0.0, 0.0, 0.0, 0.0])
            for k in ti.static(range(5)):
                column[k] = src[j, mirror(2 * y + k - 2, src.shape[1]), u]
            line[t] = weigh(column[0], column[1], column[2], column[3], column[4], zero)
        dst[j, y, x] = weigh(line[0], line[1], line[2], line[3], line[4], zero)


@primitive
def reduce(levels: Sequence[np.ndarray], planes: int) -> None:
    """Make the first planes of each level from the next larger one, which comes before it.

    They are smoothed, and every second row and column is kept. One thread a value.
    """
    for src, dst in pairwise(levels):
        _reduce(src, planes, 0, dst)


@ti.kernel
def _collapse(
    fine: f32_3,
    coarse: f32_3,
    below: ti.i32,
    share: ti.f32,
    lowest: ti.f32,
    step: ti.f32,
    sigma: ti.f32,
    slope: ti.f32,
    zero: ti.i32,
    # outputs
    out: f32_3,
):
    height, width = out.shape[1], out.shape[2]
    references = coarse.shape[0] - 2
    for y, x in ti.ndrange(height, width):
        total = product(share, enlarged(coarse, below, height, width, y, x, zero), zero)
        base = fine[references if fine.shape[0] > 1 else 0, y, x]
        place = product(base - lowest, quotient(1.0, step, zero), zero)
        first = ti.max(ti.cast(place, ti.i32), 0)
        for j in range(first, ti.min(first + 2, references)):
            about = lowest + product(ti.cast(j, ti.f32), step, zero)
            value = fine[j if fine.shape[0] > 1 else 0, y, x]
            if sigma > 0.0:
                value = _remapped(value, about, sigma, slope, zero)
            weight = ti.max(1.0 - ti.abs(place - ti.cast(j, ti.f32)), 0.0)
            band = value - enlarged(coarse, j, height, width, y, x, zero)
            total += product(weight, band, zero)
        out[out.shape[0] - 1, y, x] = total


@primitive
def collapse(
    levels: Sequence[np.ndarray],
    lowest: float,
    step: float,
    sigma: float,
    slope: float,
    out: np.ndarray,
) -> None:
    """Add the bands of all levels, between references, from the smallest to the image itself.

    The first level is the image, of one plane. The smallest counts by `slope`, as it is. Results
    stand in the last plane of each level, and of the image in `out`. One thread a pixel.
    """
    references = levels[-1].shape[0] - 2
    below, share = references, slope
    for n in range(len(levels) - 2, -1, -1):
        fine, coarse = levels[n], levels[n + 1]
        _collapse(
            fine, coarse, below, share, lowest, step, 0.0 if n else sigma, slope, 0,
            fine if n else out,
        )  # fmt: skip
        below, share = references + 1, 1.0
