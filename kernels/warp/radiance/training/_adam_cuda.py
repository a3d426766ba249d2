"""Adam and gradient clipping on CUDA: a thread takes four numbers, in 16-byte loads and stores.

adam.py has the equations.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance._fixed_point import NATIVE
from cvkern.kernels.warp.radiance._sums_cuda import WARPS

from ._structs import AdamRule, Learnt

OPTIONS = {"enable_backward": False}
wp.set_module_options(OPTIONS)


def threads(count: int) -> int:
    """Return the number of threads: one per four numbers, and one per remaining number."""
    return count // 4 + count % 4


@cache
def adam(scalar: Any) -> wp.Kernel:
    """Return the kernel that also writes a copy of the weights in a given precision."""

    @_native.func_native("_adam_cuda.cu", HALF=int(scalar is wp.float16))
    def move(
        thread: int,
        rate: wp.array[float],
        factor: wp.array[float],
        rule: AdamRule,
        learnt: Learnt,
        copy: wp.array[scalar],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def adam(
        rate: wp.array[float],  # (3,): of learning, and what the two means have to be divided by
        factor: wp.array[float],  # (1,): of the gradients
        rule: AdamRule,
        # outputs
        learnt: Learnt,  # the gradients are set to 0
        copy: wp.array[scalar],  # (N,): the weights again
    ):
        move(wp.tid(), rate, factor, rule, learnt, copy)

    return adam


@_native.func_native("_gradients_cuda.cu", **NATIVE)
def collect_some(thread: int, sums: wp.array[wp.int64], gradients: wp.array[float]): ...


@wp.kernel
def collect(
    # outputs
    sums: wp.array[wp.int64],  # (N,): set to 0
    gradients: wp.array[float],  # (N,): added to
):
    collect_some(wp.tid(), sums, gradients)


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
