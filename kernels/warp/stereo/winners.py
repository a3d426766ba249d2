"""The winner among the costs of a pixel, in Warp.

The winner is the disparity with the smallest cost; the neighbouring costs give its sub-pixel part
(D. Scharstein and R. Szeliski, IJCV 47, 2002). The confidence is the peak ratio (X. Hu and P.
Mordohai, IEEE PAMI 34(11), 2012). _winner.h has the equations. On the CPU a thread takes a slab of
rows, on CUDA a group of threads takes a pixel.
"""

import warp as wp

from cvkern.kernels.codes.stereo import Rule, Winners
from cvkern.kernels.warp._launch import launch_each, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp._structs import struct_of

from . import _winners_cpu as cpu
from . import _winners_cuda as cuda
from ._winner import WinnerArrays, WinnerRule


@wp.kernel(enable_backward=False)
def _largest(
    stride: int,
    first: int,
    last: int,
    costs: wp.array2d[wp.uint16],  # (H W, D)
    # outputs
    most: wp.array[int],  # (H W,)
):
    for pixel in range(first + wp.tid(), last, stride):
        m = wp.uint16(0)
        for d in range(costs.shape[1]):
            m = wp.max(m, costs[pixel, d])
        most[pixel] = int(m)


def largest(costs: wp.array, most: wp.array) -> None:
    """Find the largest cost of each pixel; one thread per pixel on CUDA."""
    pixels, depth = most.size, costs.shape[2]
    flat = view(costs, wp.uint16, (pixels, depth))
    launch_each(_largest, pixels, costs.size, [flat], [view(most, wp.int32, (pixels,))])


def pick(costs: wp.array, rule: Rule, winners: Winners) -> None:
    """Find the smallest cost of each pixel, its sub-pixel disparity, and the confidence."""
    if winners.index.device.is_cuda:
        cuda.pick(costs, rule, winners)
        return
    height, _, depth = costs.shape
    count = slabs(height, costs.size)
    line = cpu.kind_of(costs.dtype).scalar
    lines = scratch("winner.line", (count, cpu.padded(depth)), line, costs.device)
    launch_slabs(
        cpu.pick(costs.dtype),
        height,
        count,
        [costs, struct_of(WinnerRule, rule), lines],
        [struct_of(WinnerArrays, winners)],
    )


def pick_right(costs: wp.array, first: int, index: wp.array) -> None:
    """Find the smallest cost of each right pixel, on the diagonals of the volume."""
    height, width, depth = costs.shape
    if index.device.is_cuda:
        cuda.pick_right(costs, first, index)
        return
    count = slabs(height, costs.size)
    kind, reach = cpu.kind_of(costs.dtype), cpu.padded(depth)
    row = (count, width + 2 * reach)
    lines = scratch("winner.line", (count, reach), kind.scalar, index.device)
    best = scratch("winner.best", row, kind.scalar, index.device)
    place = scratch("winner.place", row, kind.place, index.device)
    kernel = cpu.pick_right(costs.dtype)
    launch_slabs(kernel, height, count, [costs, first, lines, best, place], [index])
