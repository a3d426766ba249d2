"""The line that a point belongs to, in Warp: a thread takes a slab of points (CPU), or a point."""

import warp as wp

from cvkern.kernels.warp._lanes_cpu import WIDE
from cvkern.kernels.warp._launch import launch, launch_slabs, slabs

from . import _segments_cpu as cpu
from . import _segments_cuda as cuda


def claim(
    points: wp.array,
    codes: wp.array,
    after: wp.array,
    lines: wp.array,
    directions: wp.array,
    distance: float,
    tolerance: int,
    labels: wp.array,
) -> None:
    """Label every point with the first line after `after` that it is on, or the number of lines.

    `lines` has rows of cosines, sines and distances, (3, K).
    """
    number = points.shape[0]
    inputs = [points, codes, after, lines, directions, distance, tolerance]
    if points.device.is_cuda:
        launch(cuda.claim, number, inputs, [labels])
        return
    groups = -(-number // WIDE)
    launch_slabs(cpu.claim, groups, slabs(groups, number * lines.shape[1]), inputs, [labels])
