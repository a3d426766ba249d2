"""Differences of the levels of a Laplacian pyramid, and every so many pixels, in Warp.

A level is the image minus what its next smaller version shows at the same size [P. Burt and
E. Adelson, "The Laplacian pyramid as a compact image code", IEEE Trans. Communications 31, 1983].
One thread takes an element; on the CPU, a slab of them.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def subtract(a: wp.array, b: wp.array, dst: wp.array) -> None:
    """Subtract b from a; one thread an element."""
    launch_each(_difference, dst.shape[0], dst.size, [a, b], [dst])


def thin(src: wp.array, step: int, dst: wp.array) -> None:
    """Take every `step`-th row and column; one thread a pixel of the result."""
    launch_each(_thin, dst.size, dst.size, [src, step], [dst])


@wp.kernel
def _difference(
    stride: int,
    first: int,
    last: int,
    a: wp.array[float],
    b: wp.array[float],
    # outputs
    dst: wp.array[float],
):
    for i in range(first + wp.tid(), last, stride):
        dst[i] = a[i] - b[i]


@wp.kernel
def _thin(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[float],
    step: int,
    # outputs
    dst: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        y = i // dst.shape[1]
        x = i - y * dst.shape[1]
        dst[y, x] = src[y * step, x * step]
