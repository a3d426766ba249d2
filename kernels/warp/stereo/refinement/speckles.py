"""Removal of small regions of disparities, in Warp.

Two pixels that share a side belong to one region if they differ by at most `difference`. Regions
are found by union-find: labels form trees within their region, and the root of a tree holds the
size of the region. On the CPU labels belong to runs of pixels and a thread takes a slab of rows; on
CUDA a thread takes a pixel.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs

from . import _speckles_cpu as cpu
from . import _speckles_cuda as cuda


def remove_speckles(disparity: wp.array, min_size: int, difference: float, kept: wp.array) -> None:
    """Keep the regions of at least `min_size` pixels; neighbours differ by at most `difference`."""
    size, device = kept.size, kept.device
    parents = scratch("speckles.parents", (size,), wp.int32, device)
    sizes = scratch("speckles.sizes", (size,), wp.int32, device)
    if device.is_cuda:
        launch(cuda.plant, size, [disparity, difference], [parents, sizes])
        launch(cuda.merge, size, [disparity, difference], [parents])
        launch(cuda.count, size, [min_size], [parents, sizes])
        launch(cuda.keep, size, [disparity, min_size, parents, sizes], [kept])
        return
    height, width = kept.shape
    count = slabs(height, size)
    shape = height, -(-width // 64)
    begins = scratch("speckles.begins", shape, wp.uint64, device)
    joints = scratch("speckles.joints", shape, wp.uint64, device)
    runs, trees = [width, begins, joints], [parents, sizes]
    launch_slabs(cpu.mark, height, count, [disparity, difference], [begins, joints])
    launch_slabs(cpu.join_slab, height, count, runs, trees)
    launch(cpu.join_slabs, 1, [count, *runs], trees)
    launch_slabs(cpu.keep, height, count, [disparity, min_size, begins, *trees], [kept])
