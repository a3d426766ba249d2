"""Resizing along one axis at a time, in Warp."""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch_each, launch_slabs, slabs

from ._taps import stored

OPTIONS = {"enable_backward": False, "fuse_fp": False}
FEW = 16  # elements side by side, from which on they are worth a loop of their own


def resample(src: wp.array, starts: wp.array, weights: wp.array, dst: wp.array) -> None:
    """Weigh the pixels of each line from its start on, for each pixel; one thread an element."""
    count = dst.shape[0] * dst.shape[1]
    if not dst.device.is_cuda:
        whole = dst.shape[2] < FEW
        count = dst.shape[0] if whole else count
        parts = slabs(count, dst.size * weights.shape[1])
        kernel = resample_lines_cpu(src.dtype, dst.dtype, whole)
        launch_slabs(kernel, count, parts, [src, starts, weights], [dst])
        return
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


@lru_cache
def resample_lines_cpu(scalar: Any, result: Any, whole: bool) -> wp.Kernel:
    """Make the same kernel for the CPU: of whole lines, or of elements that lie side by side.

    Plain Warp takes about ten times as long: it indexes each element, and forms no vectors.
    """
    native = _native.func_native("_resampling_cpu.h", ROUNDED=int(result is wp.uint8))

    @native
    def resample_line(
        o: int,
        src: wp.array3d[scalar],
        starts: wp.array[int],
        weights: wp.array2d[float],
        dst: wp.array3d[result],
    ): ...

    @native
    def resample_element(
        o: int,
        k: int,
        src: wp.array3d[scalar],
        starts: wp.array[int],
        weights: wp.array2d[float],
        dst: wp.array3d[result],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def resample_rows(
        slab: int,
        first: int,
        last: int,
        src: wp.array3d[scalar],
        starts: wp.array[int],
        weights: wp.array2d[float],
        # outputs
        dst: wp.array3d[result],
    ):
        m = dst.shape[1]
        for item in range(first, last):
            if wp.static(whole):
                resample_line(item, src, starts, weights, dst)
            else:
                o = item // m
                resample_element(o, item - o * m, src, starts, weights, dst)

    return resample_rows
