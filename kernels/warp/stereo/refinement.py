"""Refinement of disparity maps, where NaN stands for no disparity, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs

from . import _refinement_cpu as cpu
from . import _refinement_cuda as cuda


def left_right(
    disparity: wp.array, right: wp.array, first: int, tolerance: float, checked: wp.array
) -> None:
    """Keep the disparities that the right image shares.

    `right` is float32 disparities, or int32 indices that count from `first` on and are negative
    where there is none.
    """
    options = [disparity, right, first, tolerance]
    if checked.device.is_cuda:
        launch(cuda.left_rights[right.dtype], checked.size, options, [checked])
        return
    height = checked.shape[0]
    kernel = cpu.left_rights[right.dtype]
    launch_slabs(kernel, height, slabs(height, checked.size), options, [checked])


def remove_speckles(disparity: wp.array, min_size: int, difference: float, kept: wp.array) -> None:
    """Keep the regions of at least `min_size` pixels, whose neighbours differ by `difference`."""
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


def fill(disparity: wp.array, filled: wp.array, valid: wp.array) -> None:
    """Fill gaps with the smaller of the disparities to the left and right; tell where none was.

    A row without any is that of the nearest row above that has some, else below.
    """
    height = filled.shape[0]
    found = scratch("fill.found", (height,), wp.int32, filled.device)
    if filled.device.is_cuda:
        launch(cuda.fill, 32 * height, [disparity], [filled, valid, found])
        launch(cuda.find_sources, 1, [], [found])
        launch(cuda.fill_empty_rows, 32 * height, [found], [filled])
        return
    count = slabs(height, filled.size)
    launch_slabs(cpu.fill, height, count, [disparity], [filled, valid, found])
    launch(cpu.find_sources, 1, [], [found])
    launch_slabs(cpu.fill_empty_rows, height, count, [found], [filled])


def guided_median(
    disparity: wp.array, guide: wp.array, radius: int, contrast: int, smooth: wp.array
) -> None:
    """Weighted median along the rows, then of that down the columns.

    A pixel that differs by g from the middle one in the guide weighs ``max(1, contrast - g)``. The
    image is continued by its nearest pixel.
    """
    height, width = smooth.shape
    across = scratch("guided_median.across", (height, width), wp.float32, smooth.device)
    if smooth.device.is_cuda:
        along, down = cuda.medians(radius)
        launch(along, smooth.size, [disparity, guide, contrast], [across])
        launch(down, smooth.size, [across, guide, contrast], [smooth])
        return
    options = [guide, radius, contrast]
    count = slabs(height, smooth.size * (2 * radius + 1))
    line = (count, width + 2 * radius)
    lines = scratch("guided_median.lines", line, wp.float32, smooth.device)
    grays = scratch("guided_median.grays", line, wp.uint8, smooth.device)
    launch_slabs(cpu.medians_along, height, count, [disparity, *options, lines, grays], [across])
    launch_slabs(cpu.medians_down, height, count, [across, *options], [smooth])
