"""Images seen through a homography, in Warp: the map and the sample in one kernel."""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch_each

from ._taps import AWAY, mapped, sampler, stored, taps

OPTIONS = {"enable_backward": False, "fuse_fp": False}


def warp_perspective(
    src: wp.array,
    inverse: wp.array,
    order: int,
    border: int,
    cval: float,
    margin: int,
    dst: wp.array,
) -> None:
    """Sample an image where `inverse` takes the pixels of the result; one thread a pixel."""
    kernel = warp_kernel(src.dtype, dst.dtype, order)
    count = dst.shape[1] * dst.shape[2]
    launch_each(kernel, count, dst.size, [src, inverse, border, cval, margin], [dst])


@lru_cache
def warp_kernel(scalar: Any, result: Any, order: int) -> wp.Kernel:
    """Make the kernel that samples arrays of `scalar`."""
    _, _, indices, weights, _ = taps(order)
    sample = sampler(scalar, order)
    store = stored(result)

    @wp.kernel(module="unique", module_options=OPTIONS)
    def warp_pixels(
        stride: int,
        first: int,
        last: int,
        src: wp.array4d[scalar],  # (P, H, W, C)
        inverse: wp.array[wp.float64],  # (9,), acts on (x, y, 1) of the result
        border: int,
        cval: float,
        margin: int,
        # outputs
        dst: wp.array4d[result],  # (P, H', W', C)
    ):
        width = dst.shape[2]
        outside = store(cval)
        for item in range(first + wp.tid(), last, stride):
            i = item // width
            j = item - i * width
            u = wp.float64(j)
            v = wp.float64(i)
            w = inverse[6] * u + inverse[7] * v + inverse[8]
            shift = wp.float64(margin)
            px = (inverse[0] * u + inverse[1] * v + inverse[2]) / w + shift
            py = (inverse[3] * u + inverse[4] * v + inverse[5]) / w + shift
            y = mapped(py, src.shape[1], border)[0]
            x = mapped(px, src.shape[2], border)[0]
            if y == wp.float64(AWAY) or x == wp.float64(AWAY):
                for p in range(dst.shape[0]):
                    for c in range(dst.shape[3]):
                        dst[p, i, j, c] = outside
            else:
                rows = indices(y, src.shape[1], border)
                columns = indices(x, src.shape[2], border)
                down = weights(y)
                along = weights(x)
                for p in range(dst.shape[0]):
                    for c in range(dst.shape[3]):
                        dst[p, i, j, c] = store(sample(src, p, c, rows, columns, down, along))

    return warp_pixels
