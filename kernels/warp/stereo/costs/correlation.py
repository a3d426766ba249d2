"""Zero-mean normalised cross-correlation of windows, in Warp."""

import warp as wp

from cvkern.kernels.codes.stereo import Cost
from cvkern.kernels.warp._launch import launch_slabs, scratch, slabs

from . import _correlation_cpu as correlation_cpu
from . import _windows_cpu as window_cpu
from . import _windows_cuda as window_cuda


def correlation(
    left: wp.array, right: wp.array, first: int, radius_y: int, radius_x: int, costs: wp.array
) -> None:
    """One less the correlation of windows of uint8 or float32 (H, W, C), each channel's mean apart.

    Sums of products of uint8 must fit into int32.
    """
    if left.device.is_cuda:
        window_cuda.correlation(left, right, first, radius_y, radius_x, costs)
        return
    height, width, channels = left.shape
    pixel, device = left.dtype, left.device
    wide = width + 2 * radius_x
    count = slabs(height, left.size * (2 * radius_y + 1))
    columns = scratch("zncc.columns", (count, 3 * wide + 4 * radius_x), wp.float64, device)
    sums, scales = [], []
    for name, image in (("left", left), ("right", right)):
        sums.append(scratch(f"zncc.{name}_sums", (height, channels, wide), wp.float64, device))
        scales.append(scratch(f"zncc.{name}_scales", (height, wide), wp.float64, device))
        launch_slabs(
            correlation_cpu.moments(pixel),
            height,
            count,
            [image, radius_y, radius_x, columns],
            [sums[-1], scales[-1]],
        )
    count = slabs(height, costs.size)
    products = wp.float64 if pixel is wp.float32 else wp.int32
    inner = window_cpu.slab_scratch(left, count, costs.shape[2], Cost.ZNCC, 1, radius_x, products)
    shape = (count, (1 + channels) * (width + window_cpu.padded(costs.shape[2], products)))
    moments = scratch("zncc.moments", shape, wp.float64, device)
    launch_slabs(
        correlation_cpu.correlation(pixel),
        height,
        count,
        [left, right, *sums, *scales, first, radius_y, radius_x, *inner, moments],
        [costs],
    )
