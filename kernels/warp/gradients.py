"""Gradients in polar form, in Warp: over lanes on the CPU, one thread an element on CUDA."""

import warp as wp

from . import _gradients_blocks as blocks
from . import _gradients_lanes as lanes
from ._lanes import LANES, f32_lanes, padded, unpad, vectors
from ._launch import launch, launch_slabs, slabs


def polar(dy: wp.array, dx: wp.array, magnitude: wp.array, orientation: wp.array) -> None:
    """Length and angle of each (dy, dx)."""
    _each(blocks.polar, lanes.polar, [dy, dx], [magnitude, orientation])


def root_mean_square(dy: wp.array, dx: wp.array, dst: wp.array) -> None:
    """``sqrt((dy^2 + dx^2) / 2)`` of each pair."""
    _each(blocks.root_mean_square, lanes.root_mean_square, [dy, dx], [dst])


def _each(
    on_cuda: wp.Kernel, on_cpu: wp.Kernel, inputs: list[wp.array], outputs: list[wp.array]
) -> None:
    """Launch a kernel that takes each element by itself."""
    size = inputs[0].size
    if inputs[0].device.is_cuda:
        flat = (size,)
        launch(on_cuda, size, [a.reshape(flat) for a in inputs], [a.reshape(flat) for a in outputs])
        return
    given = [a.reshape((1, size)) for a in (*inputs, *outputs)]
    wide = [padded(a, f"each.{i}") for i, a in enumerate(given)]
    views = [vectors(a, f32_lanes) for a in wide]
    n = len(inputs)
    launch_slabs(on_cpu, -(-size // LANES), slabs(size, size), views[:n], views[n:])
    for a, b in zip(wide[n:], given[n:], strict=True):
        unpad(a, b)
