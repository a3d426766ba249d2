"""Resizing along one axis at a time, in Warp."""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch_each

from ._taps import stored

OPTIONS = {"enable_backward": False, "fuse_fp": False}


def resample(src: wp.array, starts: wp.array, weights: wp.array, dst: wp.array) -> None:
    """Weigh the pixels of each line from its start on, for each pixel; one thread an element."""
    count = dst.shape[0] * dst.shape[1]
    launch_each(resample_kernel(src.dtype, dst.dtype), count, dst.size * weights.shape[1],
                [src, starts, weights], [dst])  # fmt: skip


@lru_cache
def resample_kernel(scalar: Any, result: Any) -> wp.Kernel:
    """Make the kernel that weighs arrays of `scalar`."""
    store = stored(result)

    @wp.kernel(module="unique", module_options=OPTIONS)
    def resample_lines(
        stride: int,
        first: int,
        last: int,
        src: wp.array3d[scalar],  # (outer, n, inner)
        starts: wp.array[int],  # (m,)
        weights: wp.array2d[float],  # (m, T)
        # outputs
        dst: wp.array3d[result],  # (outer, m, inner)
    ):
        m = dst.shape[1]
        for item in range(first + wp.tid(), last, stride):
            o = item // m
            k = item - o * m
            start = starts[k]
            for i in range(dst.shape[2]):
                total = float(0.0)
                for t in range(weights.shape[1]):
                    if weights[k, t] != 0.0:
                        total += weights[k, t] * float(src[o, start + t, i])
                dst[o, k, i] = store(total)

    return resample_lines
