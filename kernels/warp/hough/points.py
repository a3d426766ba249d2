"""The set pixels of a mask as a list, in Warp.

The points are in raster order; `starts` is the number of points above each row. On the CPU a thread
takes a slab of rows, on CUDA a warp takes a row.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, slabs

from . import _points_cpu as cpu
from . import _points_cuda as cuda


def count(mask: wp.array, starts: wp.array) -> None:
    """Count the set pixels above each row."""
    if mask.device.is_cuda:
        launch(cuda.count, cuda.dim(mask), [mask, cuda.in_words(mask)], [starts])
        launch(cuda.add_up, cuda.BLOCK, [], [starts])
        return
    height = mask.shape[0]
    launch_slabs(cpu.count, height, slabs(height, mask.size), [mask], [starts])
    launch(cpu.add_up, 1, [], [starts])


def gather(mask: wp.array, starts: wp.array, points: wp.array) -> None:
    """List row and column of the set pixels."""
    if mask.device.is_cuda:
        launch(cuda.gather, cuda.dim(mask), [mask, starts, cuda.in_words(mask)], [points])
        return
    height = mask.shape[0]
    inputs = [mask, cpu.words(mask), starts]
    launch_slabs(cpu.gather, height, slabs(height, mask.size), inputs, [points])


def first_outside(
    points: wp.array, starts: wp.array, values: wp.array, low: float, high: float, index: wp.array
) -> None:
    """Find the first point whose value is outside [low, high], or the number of points.

    One thread on the CPU, one thread per point on CUDA.
    """
    inputs = [points, starts, values, low, high]
    if points.device.is_cuda:
        launch(cuda.number_of, 1, [starts], [index])
        launch(cuda.first_outside, points.shape[0], inputs, [index])
        return
    launch(cpu.first_outside, 1, inputs, [index])
