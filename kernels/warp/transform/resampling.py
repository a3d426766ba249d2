"""Resizing by weighted means, down the rows and then along the columns, in Warp.

Pixel i of the result along an axis is ``sum_k w_ik s_(b_i + k)``: the host chooses the starts b and
the weights w, which are shares of areas for a smaller image and linear ones for a larger one. Sums
are in float32, in the order of k. On CUDA a thread takes a pixel of a pass. On the CPU
a thread makes both passes row by row (_resampling_cpu.h).
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs, view

from ._taps import stored

OPTIONS = {"enable_backward": False, "fuse_fp": False}
BLOCK = 16  # elements of the result that the CPU makes together


def resample(
    src: wp.array,
    tops: wp.array,
    down: wp.array,
    starts: wp.array,
    along: wp.array,
    dst: wp.array,
) -> None:
    """Weigh the pixels of a column from the top of each row on, then those of each row alike.

    One thread an element and pass; on the CPU a thread takes a slab of rows.
    """
    planes, height, width, channels = src.shape
    tall, wide = dst.shape[1:3]
    if not dst.device.is_cuda:
        rows = planes * tall
        parts = slabs(rows, dst.size * along.shape[1])
        even, count = along.shape[1] + along.shape[1] % 2, wide * channels
        # What has no weight is read too.
        size = (even + 2) * count + (width + even) * channels + 4 * BLOCK
        room = scratch("resample.room", (parts, size), wp.float32, dst.device)
        inputs = [src, tops, down, starts, along, room]
        launch_slabs(resample_kernel_cpu(src.dtype, dst.dtype), rows, parts, inputs, [dst])
        return
    inner = width * channels
    lines = view(src, src.dtype, (planes, height, inner))
    middle = scratch("resample.middle", (planes, tall, inner), wp.float32, dst.device)
    _resample_along(lines, tops, down, middle)
    lines = view(middle, wp.float32, (planes * tall, width, channels))
    _resample_along(lines, starts, along, view(dst, dst.dtype, (planes * tall, wide, channels)))


def _resample_along(src: wp.array, starts: wp.array, weights: wp.array, dst: wp.array) -> None:
    """Weigh the pixels of each line from its start on, for each pixel."""
    launch(resample_kernel(src.dtype, dst.dtype), dst.size, [src, starts, weights], [dst])


@lru_cache
def resample_kernel(scalar: Any, result: Any) -> wp.Kernel:
    """Make the kernel of CUDA that weighs arrays of `scalar`: a thread an element."""
    store = stored(result)

    @wp.kernel(module="unique", module_options=OPTIONS)
    def resample_lines(
        src: wp.array3d[scalar],  # (outer, n, inner)
        starts: wp.array[int],  # (m,)
        weights: wp.array2d[float],  # (m, T)
        # outputs
        dst: wp.array3d[result],  # (outer, m, inner)
    ):
        item = wp.tid()
        line = item // dst.shape[2]
        i = item - line * dst.shape[2]
        o = line // dst.shape[1]
        k = line - o * dst.shape[1]
        start = starts[k]
        total = float(0.0)
        for t in range(weights.shape[1]):
            weight = weights[k, t]
            if weight != 0.0:
                total += weight * float(src[o, start + t, i])
        dst[o, k, i] = store(total)

    return resample_lines


@lru_cache
def resample_kernel_cpu(scalar: Any, result: Any) -> wp.Kernel:
    """Make the kernel of both passes for the CPU.

    Plain Warp takes many times as long: it indexes each element, and forms no vectors.
    """

    @_native.kernel("_resampling_cpu.h", OPTIONS, ROUNDED=int(result is wp.uint8))
    def resample_rows(
        slab: int,
        first: int,
        last: int,
        src: wp.array4d[scalar],  # (P, H, W, C)
        tops: wp.array[int],  # (H',)
        down: wp.array2d[float],  # (H', T)
        starts: wp.array[int],  # (W',)
        along: wp.array2d[float],  # (W', T')
        # scratch
        room: wp.array2d[float],  # one line per slab
        # outputs
        dst: wp.array4d[result],  # (P, H', W', C)
    ): ...

    return resample_rows
