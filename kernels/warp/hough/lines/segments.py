"""Which line a point belongs to, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, slabs

from . import _segments_cpu as cpu
from . import _segments_cuda as cuda


def claim(
    points: wp.array,
    codes: wp.array,
    after: wp.array,
    cosine: wp.array,
    sine: wp.array,
    rho: wp.array,
    directions: wp.array,
    distance: float,
    tolerance: int,
    labels: wp.array,
) -> None:
    """Label every point with the first line, behind `after`, that it is on, or their number.

    One thread a slab of points, or one a point.
    """
    number = points.shape[0]
    inputs = [points, codes, after, cosine, sine, rho, directions, distance, tolerance]
    if points.device.is_cuda:
        launch(cuda.claim, number, inputs, [labels])
        return
    groups = -(-number // cpu.POINTS)
    launch_slabs(cpu.claim, groups, slabs(groups, number * cosine.shape[0]), inputs, [labels])
