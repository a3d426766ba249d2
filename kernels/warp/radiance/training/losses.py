"""Losses of rendered colours against photographs, and their gradients, in Warp.

Over a background B, a ray of colour C and opacity O has the colour F = C + (1 - O) B, and the
photograph, of colour S and opacity a, has P = a S + (1 - a) B. The loss of a ray is the mean over
the channels of l(F - P), where l is the square, or Huber's: e^2 / 2 for |e| < k and k (|e| - k / 2)
beyond. So with D = l' / 3,

    dL/dC = D,  dL/dO = -<D, B>,  dL/dB = D (a - O).

A camera clips what is too bright or too dark. If `censored`, there is no error where P is 1 and F
above, or P is 0 and F below, in pixels with a = 1.
"""

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.codes.radiance import Background, Draw
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp._random import random_unit
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance._structs import Comparison

wp.set_module_options({"enable_backward": False})

RED, GREEN, BLUE = (wp.constant(int(d)) for d in (Draw.RED, Draw.GREEN, Draw.BLUE))


@wp.func
def background_of(comparison: Comparison, ray: int) -> wp.vec3:
    """Return the background of a ray."""
    kind = comparison.kind
    seed = comparison.seed
    step = comparison.step[0]
    if kind == Background.WHITE:
        return wp.vec3(1.0, 1.0, 1.0)
    if kind == Background.RANDOM:
        return wp.vec3(
            random_unit(seed, step, ray, RED),
            random_unit(seed, step, ray, GREEN),
            random_unit(seed, step, ray, BLUE),
        )
    if kind == Background.LEARNT:
        return wp.vec3(comparison.learnt[0], comparison.learnt[1], comparison.learnt[2])
    return wp.vec3(0.0, 0.0, 0.0)


@wp.func
def error_of(error: float, target: float, seen: float, comparison: Comparison) -> float:
    """Return the error of a channel, 0 beyond the end of the range that its photograph has."""
    clipped = (target >= 1.0 and error > 0.0) or (target <= 0.0 and error < 0.0)
    return wp.where(comparison.censored and seen >= 1.0 and clipped, 0.0, error)


@wp.kernel
def loss_kernel(
    stride: int,
    first: int,
    last: int,
    color: wp.array2d[float],  # (R, 3)
    opacity: wp.array[float],  # (R,)
    targets: wp.array2d[float],  # (R, 4)
    active: wp.array[int],  # (1,)
    comparison: Comparison,
    # outputs
    errors: wp.array[float],  # (R,): mean squared error of each ray
    d_color: wp.array2d[float],  # (R, 3)
    d_opacity: wp.array[float],  # (R,)
    d_learnt: wp.array2d[float],  # (R, 3)
):
    """Compare a ray with its target."""
    for ray in range(first + wp.tid(), last, stride):
        if ray < active[0]:
            behind = background_of(comparison, ray)
            through = 1.0 - opacity[ray]
            seen = targets[ray, 3]
            error = float(0.0)
            d_through = float(0.0)
            for k in range(3):
                found = color[ray, k] + through * behind[k]
                wanted = seen * targets[ray, k] + (1.0 - seen) * behind[k]
                e = error_of(found - wanted, targets[ray, k], seen, comparison)
                error += e * e / 3.0
                d = 2.0 * e
                if comparison.huber > 0.0:
                    huber = comparison.huber
                    d = wp.where(wp.abs(e) > huber, wp.sign(e) * huber, e)  # keeps NaN
                d *= comparison.scale / 3.0
                d_color[ray, k] = d
                d_through += d * behind[k]
                d_learnt[ray, k] = d * (seen - opacity[ray])
            errors[ray] = error
            d_opacity[ray] = -d_through
        else:
            errors[ray] = 0.0


def loss(
    color: wp.array,
    opacity: wp.array,
    targets: wp.array,
    active: wp.array,
    comparison: codes.Comparison,
    errors: wp.array,
    d_color: wp.array,
    d_opacity: wp.array,
    d_learnt: wp.array,
) -> None:
    """Compute the squared error of each ray, and the gradients of its loss times a scale.

    `color` (R, 3) and `opacity` (R,) of the first `active` (1,) rays are compared with `targets`
    (R, 4), the colour and opacity of the photographs. `errors` (R,) are squared errors, averaged
    over the channels, for every loss, and 0 for the other rays. `d_color` (R, 3), `d_opacity` (R,)
    and `d_learnt` (R, 3), one row per ray, are not written for the other rays.
    """
    count = opacity.shape[0]
    inputs = [color, opacity, targets, active, struct_of(Comparison, comparison)]
    launch_each(loss_kernel, count, 64 * count, inputs, [errors, d_color, d_opacity, d_learnt])
