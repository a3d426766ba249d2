"""Logarithms of the ratio of an image and its surroundings, or its neighbours, in Warp.

Each scale of a retinex adds ``w log((I + c) / (S + c))``, where S is the smoothed image [D. Jobson,
Z. Rahman and G. Woodell, "A multiscale retinex for bridging the gap between color images and the
human observation of scenes", IEEE Transactions on Image Processing 6(7), 1997]. By gradients, a
step between neighbours counts if their ratio is above a threshold [J. M. Morel, A. B. Petro and
C. Sbert, "A PDE formalization of retinex theory", IEEE Transactions on Image Processing 19(11),
2010]; ratios are compared by a product, so that all devices keep the same steps. Logarithms agree
between devices to rounding. One thread takes a value or a pixel; on the CPU, a slab of them.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def add_log_ratio(
    image: wp.array, smooth: wp.array, low: float, weight: float, out: wp.array
) -> None:
    """Add the weighted logarithm of an image over its surroundings, both raised by `low`."""
    launch_each(_add_log_ratio, out.shape[0], 8 * out.size, [image, smooth, low, weight], [out])


def steps(
    image: wp.array, channel: int, low: float, ratio: float, weights: wp.array, rises: wp.array
) -> None:
    """Write the logarithms of ratios to the right and below, 0 of small ones, and where they are.

    `image` (H, W, C) is raised by `low`; outputs are (2, H, W).
    """
    count = image.shape[0] * image.shape[1]
    launch_each(_steps, count, 16 * count, [image, channel, low, ratio], [weights, rises])


def put(values: wp.array, mean: float, channel: int, out: wp.array) -> None:
    """Write values less their mean to a channel."""
    launch_each(_put, values.size, 2 * values.size, [values, mean, channel], [out])


@wp.kernel
def _add_log_ratio(
    stride: int,
    first: int,
    last: int,
    image: wp.array[float],
    smooth: wp.array[float],
    low: float,
    weight: float,
    # outputs
    out: wp.array[float],
):
    for i in range(first + wp.tid(), last, stride):
        here = wp.max(image[i], 0.0) + low
        around = wp.max(smooth[i], 0.0) + low
        out[i] = out[i] + weight * wp.log(here / around)


@wp.kernel
def _steps(
    stride: int,
    first: int,
    last: int,
    image: wp.array3d[float],
    channel: int,
    low: float,
    ratio: float,
    # outputs
    weights: wp.array3d[float],
    rises: wp.array3d[float],
):
    for i in range(first + wp.tid(), last, stride):
        y = i // image.shape[1]
        x = i - y * image.shape[1]
        here = wp.max(image[y, x, channel], 0.0) + low
        for axis in range(2):
            v = y + axis
            u = x + 1 - axis
            weight = float(0.0)
            rise = float(0.0)
            if v < image.shape[0] and u < image.shape[1]:
                weight = 1.0
                there = wp.max(image[v, u, channel], 0.0) + low
                if there > here * ratio or here > there * ratio:
                    rise = wp.log(there / here)
            weights[axis, y, x] = weight
            rises[axis, y, x] = rise


@wp.kernel
def _put(
    stride: int,
    first: int,
    last: int,
    values: wp.array2d[wp.float64],
    mean: wp.float64,
    channel: int,
    # outputs
    out: wp.array3d[float],
):
    for i in range(first + wp.tid(), last, stride):
        y = i // out.shape[1]
        x = i - y * out.shape[1]
        out[y, x, channel] = wp.float32(values[y, x] - mean)
