"""The winner among the costs of a pixel, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs
from cvkern.kernels.warp.stereo.paths.aggregation import _padded

from . import _winners_cpu as winner_cpu
from . import _winners_cuda as winner_cuda


def largest(costs: wp.array, most: wp.array) -> None:
    """Find the largest cost of each pixel."""
    if most.device.is_cuda:
        launch(winner_cuda.largest, most.shape, [costs], [most])
        return
    height = most.shape[0]
    launch_slabs(winner_cpu.largest, height, slabs(height, costs.size), [costs], [most])


def pick(
    costs: wp.array,
    first: int,
    subpixel: int,
    uniqueness: int,
    index: wp.array,
    disparity: wp.array,
    cost: wp.array,
    confidence: wp.array,
) -> None:
    """Find the least cost of each pixel, the disparity between the pixels, and how sure it is."""
    options, outputs = [costs, first, subpixel, uniqueness], [index, disparity, cost, confidence]
    if index.device.is_cuda:
        winner_cuda.pick(*options, *outputs)
        return
    height, _, depth = costs.shape
    count = slabs(height, costs.size)
    kind = winner_cpu.kinds[costs.dtype]
    lines = scratch("winner.line", (count, _padded(depth)), kind.scalar, index.device)
    launch_slabs(winner_cpu.picks[costs.dtype], height, count, [*options, lines], outputs)


def pick_right(costs: wp.array, first: int, index: wp.array) -> None:
    """Find the least cost of each pixel of the right image, on the diagonals of the volume."""
    height, width, depth = costs.shape
    if index.device.is_cuda:
        winner_cuda.pick_right(costs, first, index)
        return
    count = slabs(height, costs.size)
    kind, padded = winner_cpu.kinds[costs.dtype], _padded(depth)
    row = (count, width + 2 * padded)
    lines = scratch("winner.line", (count, padded), kind.scalar, index.device)
    best = scratch("winner.best", row, kind.scalar, index.device)
    place = scratch("winner.place", row, kind.index, index.device)
    kernel = winner_cpu.picks_right[costs.dtype]
    launch_slabs(kernel, height, count, [costs, first, lines, best, place], [index])
