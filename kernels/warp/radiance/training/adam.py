"""Adam [Kingma and Ba 2015], learning rates and gradient clipping, in Warp."""

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.warp._launch import BLOCK, launch, launch_slabs, slabs
from cvkern.kernels.warp._structs import struct_of

from . import _adam_cpu as cpu
from . import _adam_cuda as cuda
from ._structs import AdamRule, Learnt

wp.set_module_options({"enable_backward": False})


@wp.kernel
def rate_kernel(
    step: wp.array[int],  # (1,)
    progress: wp.array[float],  # (1,): share of the training that is done
    base: float,
    warmup: int,
    final: float,
    beta1: float,
    beta2: float,
    # outputs
    rate: wp.array[float],  # (3,)
):
    """Compute the numbers that are the same for all weights."""
    steps = float(step[0] + 1)
    warm = wp.min(1.0, steps / float(wp.max(warmup, 1)))
    rate[0] = base * warm * wp.pow(final, progress[0])
    # Both means begin at 0, so they are too small by these factors.
    rate[1] = 1.0 - wp.pow(beta1, steps)
    rate[2] = 1.0 - wp.pow(beta2, steps)


@wp.kernel
def advance_kernel(
    # outputs
    step: wp.array[int],  # (1,)
):
    """Add 1."""
    step[0] = step[0] + 1


def adam(
    rate: wp.array,
    factor: wp.array,
    rule: codes.AdamRule,
    learnt: codes.Learnt,
    copy: wp.array,
) -> None:
    """Take a step of Adam for N weights, with their gradients times `factor` (1,); reset these.

    `rate` (3,) is that of :func:`learning_rate`. `copy` (N,) is filled with the weights in its own
    precision; it may be the array of weights itself.
    """
    count = copy.shape[0]
    inputs = [rate, factor, struct_of(AdamRule, rule)]
    outputs = [struct_of(Learnt, learnt), copy]
    if copy.device.is_cuda:
        launch(cuda.adam(copy.dtype), count, inputs, outputs)
    else:
        launch_slabs(cpu.adam, count, slabs(count, 4 * count), inputs, outputs)


def collect(sums: wp.array, gradients: wp.array) -> None:
    """Add `sums` (N,), int64 fixed-point numbers, to `gradients` (N,), and reset the sums to 0.

    Gradients are collected in these sums if the order must have no effect.
    """
    count = sums.shape[0]
    if sums.device.is_cuda:
        launch(cuda.collect, count, [], [sums, gradients])
    else:
        launch_slabs(cpu.collect, count, slabs(count, 2 * count), [], [sums, gradients])


def learning_rate(
    step: wp.array,
    progress: wp.array,
    base: float,
    warmup: int,
    final: float,
    beta1: float,
    beta2: float,
    rate: wp.array,
) -> None:
    """Increase a rate linearly over `warmup` steps, and decrease it exponentially to `final` of it.

    `rate` (3,) is filled for step `step` (1,) at `progress` (1,): the rate, and the divisors of the
    two means of Adam.
    """
    launch(rate_kernel, 1, [step, progress, base, warmup, final, beta1, beta2], [rate])


def add_squares(gradients: wp.array, parts: wp.array) -> None:
    """Add the squares of `gradients` (N,) to `parts` (P,), always in the same order.

    On CUDA the gradients begin at a multiple of 16 bytes.
    """
    count = parts.shape[0]
    if parts.device.is_cuda:
        launch(cuda.squares, count * BLOCK, [gradients], [parts])
    else:
        number = slabs(count, gradients.shape[0])
        launch_slabs(cpu.squares, count, number, [gradients], [parts])


def clip(scale: float, most: float, parts: wp.array, factor: wp.array) -> None:
    """Set `factor` (1,) to `scale`, or to less if the norm of the result would exceed `most`.

    The sum of `parts` (P,) is the squared norm of the gradients; the parts are reset to 0.
    """
    kernel, threads = (cuda.clip, BLOCK) if parts.device.is_cuda else (cpu.clip, 1)
    launch(kernel, threads, [scale, most], [parts, factor])


def advance(step: wp.array) -> None:
    """Add 1 to `step` (1,)."""
    launch(advance_kernel, 1, [], [step])
