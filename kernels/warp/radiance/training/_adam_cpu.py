"""Adam and gradient clipping on the CPU: one thread per slab of the numbers.

adam.py has the equations. The native loops run over vectors.
"""

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance._fixed_point import fraction

from ._structs import AdamRule, Learnt

wp.set_module_options({"enable_backward": False})


@_native.func_native("_adam_cpu.h")
def move(
    first: int,
    last: int,
    rate: wp.array[float],
    factor: wp.array[float],
    rule: AdamRule,
    learnt: Learnt,
    copy: wp.array[float],
): ...


@wp.kernel
def adam(
    slab: int,
    first: int,
    last: int,
    rate: wp.array[float],  # (3,): of learning, and what the two means have to be divided by
    factor: wp.array[float],  # (1,): of the gradients
    rule: AdamRule,
    # outputs
    learnt: Learnt,  # the gradients are set to 0
    copy: wp.array[float],  # (N,): the weights again
):
    move(first, last, rate, factor, rule, learnt, copy)


@wp.kernel
def collect(
    slab: int,
    first: int,
    last: int,
    # outputs
    sums: wp.array[wp.int64],  # (N,): set to 0
    gradients: wp.array[float],  # (N,): added to
):
    for i in range(first, last):
        gradients[i] = gradients[i] + fraction(sums[i])
        sums[i] = wp.int64(0)


@_native.func_native("_norm_cpu.h")
def add_parts(first: int, last: int, gradients: wp.array[float], parts: wp.array[float]): ...


@wp.kernel
def squares(
    slab: int,
    first: int,
    last: int,
    gradients: wp.array[float],  # (N,)
    # outputs
    parts: wp.array[float],  # (P,): added to
):
    add_parts(first, last, gradients, parts)


@wp.kernel
def clip(
    scale: float,
    most: float,
    # outputs
    parts: wp.array[float],  # (P,): set to 0
    factor: wp.array[float],  # (1,)
):
    total = float(0.0)
    for part in range(parts.shape[0]):
        total += parts[part]
        parts[part] = 0.0
    norm = wp.sqrt(total) * scale
    factor[0] = scale
    if norm > most:
        factor[0] = scale * (most / norm)
