"""Logarithms of the ratio of an image and its surroundings, in Warp.

Each scale of a retinex adds ``w log((I + c) / (S + c))``, where S is the smoothed image [D. Jobson,
Z. Rahman and G. Woodell, "A multiscale retinex for bridging the gap between color images and the
human observation of scenes", IEEE Transactions on Image Processing 6(7), 1997]. Logarithms agree
between devices to rounding. One thread takes a value; on the CPU, a slab of them.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def add_log_ratio(
    image: wp.array, smooth: wp.array, low: float, weight: float, out: wp.array
) -> None:
    """Add the weighted logarithm of an image over its surroundings, both raised by `low`."""
    launch_each(_add_log_ratio, out.shape[0], 8 * out.size, [image, smooth, low, weight], [out])


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
