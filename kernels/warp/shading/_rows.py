"""Launches over the pixels of an image, on the CPU a row at a time."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch_each


def launch_rows(
    kernel: wp.Kernel,
    shape: tuple[int, int],
    elements: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
) -> None:
    """Launch a kernel over an image, whose items are pixels on CUDA and rows on the CPU.

    The fourth argument of the kernel is the number of pixels of an item. The number of elements is
    that of a pixel.
    """
    size = shape[0] * shape[1]
    run = 1 if outputs[0].device.is_cuda else shape[1]
    launch_each(kernel, size // run, elements * size, [run, *inputs], outputs)
