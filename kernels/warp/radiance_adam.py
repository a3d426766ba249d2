"""Adam [Kingma and Ba 2015], learning rates and gradient clipping, in Warp."""

from functools import cache
from typing import Any

import warp as wp

from ._launch import launch, launch_each

OPTIONS = {"enable_backward": False}  # of kernels that are made for a dtype
wp.set_module_options(OPTIONS)


@cache
def _adam(scalar: Any) -> wp.Kernel:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def adam(
        stride: int,
        first: int,
        last: int,
        rate: wp.array[float],  # (3,): of learning, and what the two means have to be divided by
        factor: wp.array[float],  # (1,): of the gradients
        beta1: float,
        beta2: float,
        epsilon: float,
        decay: float,
        sparse: bool,
        # outputs
        gradients: wp.array[float],  # (N,): set to 0
        mean: wp.array[float],  # (N,)
        square: wp.array[float],  # (N,)
        weights: wp.array[float],  # (N,)
        copy: wp.array[scalar],  # (N,): the weights again
    ):
        learning = rate[0] / rate[1]
        mend = 1.0 / rate[2]
        for i in range(first + wp.tid(), last, stride):
            g = gradients[i] * factor[0]
            gradients[i] = 0.0
            # Entries of a table that no sample touched stay as they are.
            if not sparse or g != 0.0:
                w = weights[i]
                g += decay * w
                m = beta1 * mean[i] + (1.0 - beta1) * g
                v = beta2 * square[i] + (1.0 - beta2) * g * g
                mean[i] = m
                square[i] = v
                w -= learning * m / (wp.sqrt(v * mend) + epsilon)
                weights[i] = w
                copy[i] = scalar(w)

    return adam


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
    """Work out what is the same for all weights."""
    steps = float(step[0] + 1)
    warm = wp.min(1.0, steps / float(wp.max(warmup, 1)))
    rate[0] = base * warm * wp.pow(final, progress[0])
    # Both means begin at 0, and are too small by these factors.
    rate[1] = 1.0 - wp.pow(beta1, steps)
    rate[2] = 1.0 - wp.pow(beta2, steps)


@wp.kernel
def squares_kernel(
    gradients: wp.array[float],  # (N,)
    # outputs
    parts: wp.array[float],  # (P,): added to
):
    """Sum the squares of every P-th gradient."""
    part = wp.tid()
    total = float(0.0)
    for i in range(part, gradients.shape[0], parts.shape[0]):
        total += gradients[i] * gradients[i]
    parts[part] = parts[part] + total


@wp.kernel
def factor_kernel(
    scale: float,
    most: float,
    # outputs
    parts: wp.array[float],  # (P,): set to 0
    factor: wp.array[float],  # (1,)
):
    """Sum the parts, and shrink."""
    total = float(0.0)
    for part in range(parts.shape[0]):
        total += parts[part]
        parts[part] = 0.0
    norm = wp.sqrt(total) * scale
    shrink = float(1.0)
    if norm > most:
        shrink = most / norm
    factor[0] = scale * shrink


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
    beta1: float,
    beta2: float,
    epsilon: float,
    decay: float,
    sparse: bool,
    gradients: wp.array,
    mean: wp.array,
    square: wp.array,
    weights: wp.array,
    copy: wp.array,
) -> None:
    """One step of Adam for N weights, with `gradients` (N,) times `factor` (1,), left at 0.

    `rate` (3,) is that of :func:`learning_rate`, `decay` the share of each weight that is added to
    its gradient. If `sparse`, weights of gradient 0 and their means stay as they are.
    """
    count = weights.shape[0]
    launch_each(
        _adam(copy.dtype),
        count,
        4 * count,
        [rate, factor, beta1, beta2, epsilon, decay, sparse],
        [gradients, mean, square, weights, copy],
    )


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
    """Grow a rate linearly over `warmup` steps, and let it fall exponentially to `final` of it.

    `rate` (3,) is filled for step `step` (1,) at `progress` (1,): the rate, and what the two means
    of Adam have to be divided by.
    """
    launch(rate_kernel, 1, [step, progress, base, warmup, final, beta1, beta2], [rate])


def add_squares(gradients: wp.array, parts: wp.array) -> None:
    """Add the squares of `gradients` (N,) to `parts` (P,)."""
    launch(squares_kernel, parts.shape[0], [gradients], [parts])


def clip(scale: float, most: float, parts: wp.array, factor: wp.array) -> None:
    """Set `factor` (1,) to `scale`, or less so that gradients times it have a norm within `most`.

    `parts` (P,) sum up to the square of the norm of the gradients, and are set to 0.
    """
    launch(factor_kernel, 1, [scale, most], [parts, factor])


def advance(step: wp.array) -> None:
    """Count a step, (1,)."""
    launch(advance_kernel, 1, [], [step])
