"""Differences of the levels of a pyramid, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def subtract(a: wp.array, b: wp.array, dst: wp.array) -> None:
    """Subtract b from a; one thread an element."""
    launch_each(_difference, dst.shape[0], dst.size, [a, b], [dst])


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
