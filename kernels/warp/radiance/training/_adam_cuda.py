"""Adam and gradient clipping on CUDA: one thread per number; for sums, one per share of a block.

adam.py has the equations. Sums over a block are native (_norm_cuda.cu), for shuffles in a fixed
order.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance._fixed_point import fraction
from cvkern.kernels.warp.radiance._sums_cuda import WARPS

from ._structs import AdamRule, Learnt

OPTIONS = {"enable_backward": False}
wp.set_module_options(OPTIONS)


@cache
def adam(scalar: Any) -> wp.Kernel:
    """Return the kernel that also writes a copy of the weights in a given precision."""

    @wp.kernel(module="unique", module_options=OPTIONS)
    def adam(
        rate: wp.array[float],  # (3,): of learning, and what the two means have to be divided by
        factor: wp.array[float],  # (1,): of the gradients
        rule: AdamRule,
        # outputs
        learnt: Learnt,  # the gradients are set to 0
        copy: wp.array[scalar],  # (N,): the weights again
    ):
        i = wp.tid()
        slope = learnt.gradients[i]
        if slope != 0.0:
            learnt.gradients[i] = 0.0
        g = slope * factor[0]
        if rule.sparse and g == 0.0:
            return
        w = learnt.weights[i]
        g = g + rule.decay * w
        m = rule.beta1 * learnt.mean[i] + (1.0 - rule.beta1) * g
        v = rule.beta2 * learnt.square[i] + (1.0 - rule.beta2) * g * g
        # Both means begin at 0, so they are divided by the factors by which they are too small.
        learning = rate[0] / rate[1]
        w = w - learning * m / (wp.sqrt(v * (1.0 / rate[2])) + rule.epsilon)
        learnt.mean[i] = m
        learnt.square[i] = v
        learnt.weights[i] = w
        copy[i] = scalar(w)

    return adam


@wp.kernel
def collect(
    # outputs
    sums: wp.array[wp.int64],  # (N,): set to 0
    gradients: wp.array[float],  # (N,): added to
):
    i = wp.tid()
    total = sums[i]
    if total != wp.int64(0):
        sums[i] = wp.int64(0)
        gradients[i] = gradients[i] + fraction(total)


@_native.func_native("_norm_cuda.cu", WARPS=WARPS)
def add_block(gradients: wp.array[float], parts: wp.array[float]): ...


@wp.kernel
def squares(
    gradients: wp.array[float],  # (N,)
    # outputs
    parts: wp.array[float],  # (P,): added to, by a block each
):
    add_block(gradients, parts)


@_native.func_native("_norm_cuda.cu", WARPS=WARPS)
def shrink(scale: float, most: float, parts: wp.array[float], factor: wp.array[float]): ...


@wp.kernel
def clip(
    scale: float,
    most: float,
    # outputs
    parts: wp.array[float],  # (P,): set to 0
    factor: wp.array[float],  # (1,)
):
    shrink(scale, most, parts, factor)
