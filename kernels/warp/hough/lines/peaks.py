"""Maxima of an accumulator of lines, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, slabs

from . import _peaks as peaks


def local_maxima(
    values: wp.array,
    threshold: float,
    min_distance: int,
    min_angle: int,
    wraps: bool,
    mask: wp.array,
) -> None:
    """Mark what is above the threshold and the first largest in its window.

    One thread a slab of rows, or one an element.
    """
    of_rows, of_elements = peaks.maxima[values.dtype]
    limit = int(threshold) if values.dtype is wp.int32 else float(threshold)
    inputs = [values, limit, min_distance, min_angle, wraps]
    if values.device.is_cuda:
        launch(of_elements, values.size, inputs, [mask])
        return
    count = slabs(values.shape[0], values.size)
    count = min(4 * count, values.shape[0]) if count > 1 else 1  # maxima gather in few rows
    launch_slabs(of_rows, values.shape[0], count, inputs, [mask])
