"""Weights of rays by how likely they are to show the scene, in Taichi.

A pixel of a photograph shows the scene, with the probability p of its patch, or something else, a
distractor. In the scene, the errors of the three channels are normal with the variance v; the
colours of distractors are uniform. With the mean squared error e of the channels, a ray shows the
scene with the probability

    w = 1 / (1 + exp(-z)),    z = log(p / (1 - p)) - 3/2 e / v - 3/2 log(2 pi v),

which weighs its gradients. v is the mean of e weighted by w, and p is the mean of w over the patch
and its neighbours: expectation maximisation for a mixture of two distributions [Bishop, "Pattern
recognition and machine learning", 2006, section 9.3]. One thread takes a ray, or a patch.
"""

import math

import numpy as np
import taichi as ti

from cvkern.kernels.codes.radiance import Patches
from cvkern.kernels.taichi._launch import primitive

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)

UNIT = 256.0  # units of a share, in sums
FULL = 2.0 * math.pi


@ti.kernel
def _weigh(
    errors: f32_1,  # (R,)
    views: i32_1,  # (R,)
    pixels: i32_1,  # (R,)
    active: i32_1,  # (1,)
    share: f32_3,  # (N, h, w)
    noise: f32_1,  # (1,)
    width: ti.i32,
    side: ti.i32,
    # outputs
    sums: i32_3,  # (N, h, w)
    counts: i32_3,  # (N, h, w)
    moments: f32_2,  # (R, 3): weighted error, weight, 0
):
    for ray in range(ti.min(active[0], errors.shape[0])):
        v, e = noise[0], errors[ray]
        view, row, column = views[ray], pixels[ray] // width, pixels[ray] % width
        i, j = row // side, column // side
        p = share[view, i, j]
        z = ti.log(p / (1.0 - p)) - 1.5 * (e / v + ti.log(FULL * v))
        w = 1.0 / (1.0 + ti.exp(-z))
        moments[ray, 0] = w * e
        moments[ray, 1] = w
        moments[ray, 2] = 0.0
        sums[view, i, j] += ti.cast(UNIT * w + 0.5, ti.i32)
        counts[view, i, j] += 1


@ti.kernel
def _multiply(
    moments: f32_2,  # (R, 3): the weight is the second
    active: i32_1,  # (1,)
    # outputs
    d_color: f32_2,  # (R, 3)
    d_opacity: f32_1,  # (R,)
    d_learnt: f32_2,  # (R, 3)
):
    for ray in range(ti.min(active[0], moments.shape[0])):
        w = moments[ray, 1]
        for k in range(3):
            d_color[ray, k] *= w
            d_learnt[ray, k] *= w
        d_opacity[ray] *= w


@primitive
def weigh(
    errors: np.ndarray,
    views: np.ndarray,
    pixels: np.ndarray,
    active: np.ndarray,
    patches: Patches,
    d_color: np.ndarray,
    d_opacity: np.ndarray,
    d_learnt: np.ndarray,
    moments: np.ndarray,
) -> None:
    """Multiply gradients of rays by their weights, and count these in their patches.

    `errors` (R,) are the mean squared errors of the first `active` (1,) rays, through the `pixels`
    (R,) of the photographs `views` (R,). `d_color` (R, 3), `d_opacity` (R,) and `d_learnt` (R, 3)
    are multiplied, and `moments` (R, 3) filled with the weighted error, the weight, and 0.
    """
    _weigh(
        errors, views, pixels, active, patches.share, patches.noise, patches.width, patches.side,
        patches.sums, patches.counts, moments,
    )  # fmt: skip
    _multiply(moments, active, d_color, d_opacity, d_learnt)


@ti.kernel
def _learn_noise(
    moments: f32_1,  # (3,): sums; set to 0
    rate: ti.f32,
    least: ti.f32,
    # outputs
    noise: f32_1,  # (1,)
):
    for i in noise:
        if moments[1] > 0.0:
            found = moments[0] / moments[1]
            noise[i] = ti.max(least, noise[i] + rate * (found - noise[i]))
        for k in range(3):
            moments[k] = 0.0


@primitive
def learn_noise(moments: np.ndarray, rate: float, least: float, noise: np.ndarray) -> None:
    """Move `noise` (1,) by the share `rate` towards the weighted error of a batch.

    `moments` (3,) are the sums of those of :func:`weigh`; they are set to 0.
    """
    _learn_noise(moments, rate, least, noise)


@ti.kernel
def _settle(
    start: ti.f32,
    weight: ti.f32,
    most: ti.i32,
    # outputs
    share: f32_3,  # (N, h, w)
    sums: i32_3,  # (N, h, w)
    counts: i32_3,  # (N, h, w)
):
    for view, i, j in share:
        total, count = 0, 0
        for row in range(ti.max(i - 1, 0), ti.min(i + 2, share.shape[1])):
            for column in range(ti.max(j - 1, 0), ti.min(j + 2, share.shape[2])):
                total += sums[view, row, column]
                count += counts[view, row, column]
        found = (total / UNIT + weight * start) / (count + weight)
        share[view, i, j] = ti.math.clamp(found, 1.0 - start, start)
    for view, i, j in sums:
        if counts[view, i, j] > most:
            sums[view, i, j] //= 2
            counts[view, i, j] //= 2


@primitive
def settle(patches: Patches, start: float, weight: float, most: int) -> None:
    """Compute the shares of patches from the counted rays; halve counts above `most`.

    Each share begins with as much as `weight` rays of the share `start`, which is also the largest;
    1 - `start` is the smallest.
    """
    _settle(start, weight, most, patches.share, patches.sums, patches.counts)
