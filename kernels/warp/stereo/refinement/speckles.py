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
    height = kept.shape[0]
    count = slabs(height, size)
    labels = scratch("speckles.labels", (size,), wp.int32, device)
    regions = [labels, parents, sizes]
    launch_slabs(cpu.label_slab, height, count, [disparity, difference], regions)
    launch(cpu.join_slabs, 1, [count, disparity, difference, labels], [parents, sizes])
    launch_slabs(cpu.keep_regions, height, count, [disparity, min_size, *regions], [kept])
