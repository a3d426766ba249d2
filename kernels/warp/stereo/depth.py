"""Depth, points and point clouds from disparities, in Warp.

    depth = focal baseline / (disparity + doffs),   point = (a, b, c) / w with (a, b, c, w) = Q (x,
    y, d, 1)

as in cv2.reprojectImageTo3D. On CUDA a thread takes a pixel, on the CPU a slab of rows. One thread
per part of a row collects a cloud.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, slabs

from . import _clouds as clouds
from . import _depth_cpu as cpu
from . import _depth_cuda as cuda


def depth(disparity: wp.array, scale: float, doffs: float, depth: wp.array) -> None:
    """Compute ``scale / (disparity + doffs)``.

    The result is infinite for a sum of 0, and NaN for a sum that is negative or not finite.
    """
    if disparity.device.is_cuda:
        flat = (disparity.size,)
        launch(cuda.depth, flat, [disparity.reshape(flat), scale, doffs], [depth.reshape(flat)])
        return
    count = slabs(disparity.shape[0], disparity.size)
    launch_slabs(cpu.depth, disparity.shape[0], count, [disparity, scale, doffs], [depth])


def points(disparity: wp.array, q: wp.array, points: wp.array) -> None:
    """Map (x, y, disparity, 1) by the matrix `q` and divide by the last coordinate.

    NaN where the disparity is not finite or that coordinate is 0.
    """
    if disparity.device.is_cuda:
        launch(cuda.points, disparity.size, [disparity, q], [points])
        return
    count = slabs(disparity.shape[0], 4 * disparity.size)
    launch_slabs(cpu.points, disparity.shape[0], count, [disparity, q], [points])


def count_points(points: wp.array, mask: wp.array, counts: wp.array) -> None:
    """Count the finite points of each part of a row where `mask` is not 0; one thread per part.

    The shape of `counts` gives the number of parts, of equal width, of a row. A mask of shape
    (1, 1) means all pixels.
    """
    launch(clouds.count_points, counts.shape, [points, mask], [counts])


def gather_points(
    points: wp.array,
    mask: wp.array,
    image: wp.array,
    starts: wp.array,
    cloud: wp.array,
    colors: wp.array,
) -> None:
    """Copy the points that `count_points` counts, and their colours; `starts` gives their places.

    An image of one channel gives grey. One thread per part.
    """
    launch(clouds.gather_points, starts.shape, [points, mask, image, starts], [cloud, colors])
