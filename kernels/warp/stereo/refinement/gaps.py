"""Filling of gaps of a disparity map from the background, in Warp.

A gap takes the smaller of the two disparities that bound it along its row, because it shows
background that only the left camera sees. On the CPU a thread takes a slab of rows, on CUDA a warp
takes a row.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs

from . import _gaps_cuda as cuda
from . import _rows_cpu as cpu
from ._none import none

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def _find_sources(
    # outputs
    found: wp.array[int],  # (H,): 1 for rows with a disparity; then the row to fill from, or -1
):
    # One thread, because a row needs the result of the row before.
    height = found.shape[0]
    first = int(0)
    while first < height and found[first] == 0:
        first += 1
    source = wp.where(first < height, first, -1)
    for row in range(height):
        if found[row] != 0:
            source = row
        found[row] = source


@wp.kernel
def _fill_empty_rows(
    found: wp.array[int],  # (H,) the row to fill from, or -1
    # outputs
    filled: wp.array2d[float],  # (H, W)
):
    row = wp.tid()
    source = found[row]
    if source != row:
        for x in range(filled.shape[1]):
            value = none()
            if source >= 0:
                value = filled[source, x]
            filled[row, x] = value


def fill(disparity: wp.array, filled: wp.array, valid: wp.array) -> None:
    """Fill gaps with the smaller of the disparities to the left and right; mark valid pixels.

    A row without disparities is copied from the nearest row above that has one, or else below.
    """
    height = filled.shape[0]
    found = scratch("fill.found", (height,), wp.int32, filled.device)
    if filled.device.is_cuda:
        launch(cuda.fill_rows, 32 * height, [disparity], [filled, valid, found], cuda.BLOCK)
        launch(cuda.fill_empty_rows, 32 * height, [found], [filled], cuda.BLOCK)
        return
    count = slabs(height, filled.size)
    launch_slabs(cpu.fill, height, count, [disparity], [filled, valid, found])
    launch(_find_sources, 1, [], [found])
    launch(_fill_empty_rows, height, [found], [filled])
