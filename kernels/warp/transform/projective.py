"""Images seen through a homography, in Warp: the map and the sample in one kernel.

Pixel q = (x, y, 1) of the result shows the place ``p ~ H^-1 q`` of the image, sampled with a spline
of order 0, 1 or 3 (_taps.py). The map is in float64; of bytes that become bytes, linearly, it is in
whole steps (_bytes.py). On CUDA a thread takes a pixel, on the CPU a slab of rows; linear samples
of few channels are native there (_projective_cpu.h), and of bytes on CUDA (_projective_cuda.cu).
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.filters import Border
from cvkern.kernels.codes.transform import PLACE_BITS, START, START_HIGH, WIDEST
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, slabs

from ._bytes import byte_pixel
from ._projective_cpu import FEW, PART, TALL, native_tile
from ._taps import mapped, stored, writer

OPTIONS = {"enable_backward": False, "fuse_fp": False}
# Columns and rows of a thread, warps of a block, and blocks at once, on CUDA.
COLUMNS, ROWS, WARPS, BLOCKS = wp.constant(4), wp.constant(4), wp.constant(4), 6


def warp_perspective(
    src: wp.array,
    inverse: wp.array,
    order: int,
    border: int,
    cval: float,
    margin: int,
    dst: wp.array,
) -> None:
    """Sample an image where `inverse` takes the pixels of the result; one thread a pixel.

    For orders 0 and 1 the CPU takes vectors of pixels; on CUDA a warp takes linear bytes together.
    """
    channels, rows = src.shape[3], dst.shape[1]
    byte = src.dtype is wp.uint8 and dst.dtype is wp.uint8
    height, width = src.shape[1:3]
    few = order < 2 and channels in FEW and (not byte or max(height, width) < WIDEST)
    if few and order == 1 and byte and dst.device.is_cuda:
        blocks = -(-dst.shape[2] // (32 * COLUMNS)) * -(-rows // (WARPS * ROWS))
        threads = 32 * WARPS
        inputs = [src, inverse, border, cval]
        launch(warp_kernel_cuda(channels), blocks * threads, inputs, [dst], threads)
        return
    if few and not dst.device.is_cuda:
        parts = slabs(rows, dst.size)
        left = scratch("projective.left", (parts, TALL * PART), wp.int32, dst.device)
        kernel = warp_kernel_cpu(src.dtype, dst.dtype, channels, order)
        launch_slabs(kernel, rows, parts, [src, inverse, border, cval, left], [dst])
        return
    kernel = warp_kernel(src.dtype, dst.dtype, order)
    count = dst.shape[1] * dst.shape[2]
    launch_each(kernel, count, dst.size, [src, inverse, border, cval, margin], [dst])


@lru_cache
def warp_kernel(scalar: Any, result: Any, order: int) -> wp.Kernel:
    """Make the kernel that samples arrays of `scalar`."""
    pixel = warp_pixel(scalar, result, order)

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
        for item in range(first + wp.tid(), last, stride):
            i = item // width
            pixel(src, inverse, border, cval, margin, i, item - i * width, dst)

    return warp_pixels


@lru_cache
def warp_kernel_cpu(scalar: Any, result: Any, channels: int, order: int) -> wp.Kernel:
    """Make the kernel of the CPU for orders 0 and 1 and few channels: 16 pixels of a row at a time.

    Plain Warp finds each pixel alone, and forms no vectors.
    """
    pixel = warp_pixel(scalar, result, order)
    tile = native_tile(scalar, result, channels, order, False)

    @wp.kernel(module="unique", module_options=OPTIONS)
    def warp_rows(
        slab: int,
        first: int,
        last: int,
        src: wp.array4d[scalar],  # (P, H, W, C)
        inverse: wp.array[wp.float64],  # (9,), acts on (x, y, 1) of the result
        border: int,
        cval: float,
        # scratch
        left: wp.array2d[int],  # (slabs, TALL * PART)
        # outputs
        dst: wp.array4d[result],  # (P, H', W', C)
    ):
        constant = int(0)
        if border == int(Border.CONSTANT):
            constant = int(1)
        across = (dst.shape[2] + PART - 1) // PART
        for item in range((last - first + TALL - 1) // TALL * across):
            top = first + item // across * TALL
            start = item % across * PART
            bottom = wp.min(top + TALL, last)
            count = tile(top, bottom, start, slab, src, inverse, constant, cval, left, dst)
            for k in range(count):
                place = left[slab, k]
                row = top + place // PART
                pixel(src, inverse, border, cval, 0, row, start + place % PART, dst)

    return warp_rows


@lru_cache
def warp_kernel_cuda(channels: int) -> wp.Kernel:
    """Make the linear kernel of CUDA for bytes: a warp takes neighbouring pixels.

    Plain Warp reads and writes byte by byte.
    """
    pixel = warp_pixel(wp.uint8, wp.uint8, 1)
    store = stored(wp.uint8)

    @_native.func_native(
        "_projective_cuda.cu",
        CHANNELS=channels,
        PLACE_BITS=PLACE_BITS,
        START=START,
        START_HIGH=START_HIGH,
        COLUMNS=COLUMNS,
        ROWS=ROWS,
        WARPS=WARPS,
    )
    def warp_part(
        item: int,
        src: wp.array4d[wp.uint8],
        inverse: wp.array[wp.float64],
        constant: int,
        outside: int,
        dst: wp.array4d[wp.uint8],
    ) -> int: ...

    # Without these bounds, the pixels that are left, a few, would slow down all others.
    @wp.kernel(module="unique", module_options=OPTIONS, launch_bounds=(32 * WARPS, BLOCKS))
    def warp_parts(
        src: wp.array4d[wp.uint8],  # (P, H, W, C)
        inverse: wp.array[wp.float64],  # (9,), acts on (x, y, 1) of the result
        border: int,
        cval: float,
        # outputs
        dst: wp.array4d[wp.uint8],  # (P, H', W', C)
    ):
        item = wp.tid()
        constant = int(0)
        if border == int(Border.CONSTANT):
            constant = int(1)
        left = warp_part(item, src, inverse, constant, 0x01010101 * int(store(cval)), dst)
        if left != 0:
            across = (dst.shape[2] + 32 * COLUMNS - 1) // (32 * COLUMNS)
            block = item // (32 * WARPS)
            top = (block // across * WARPS + item // 32 % WARPS) * ROWS
            start = block % across * 32 * COLUMNS + item % 32
            for k in range(ROWS * COLUMNS):
                if ((left >> k) & 1) == 1:
                    row = top + k // COLUMNS
                    pixel(src, inverse, border, cval, 0, row, start + 32 * (k % COLUMNS), dst)

    return warp_parts


@lru_cache
def warp_pixel(scalar: Any, result: Any, order: int) -> Any:
    """Make the function that finds a pixel of the result."""
    if order == 1 and scalar is wp.uint8 and result is wp.uint8:
        return byte_pixel()
    write = writer(scalar, result, order)

    @wp.func
    def pixel(
        src: wp.array4d[scalar],
        inverse: wp.array[wp.float64],
        border: int,
        cval: float,
        margin: int,
        i: int,
        j: int,
        # outputs
        dst: wp.array4d[result],
    ):
        u = wp.float64(j)
        v = wp.float64(i)
        w = inverse[6] * u + inverse[7] * v + inverse[8]
        shift = wp.float64(margin)
        px = (inverse[0] * u + inverse[1] * v + inverse[2]) / w + shift
        py = (inverse[3] * u + inverse[4] * v + inverse[5]) / w + shift
        y = mapped(py, src.shape[1], border)[0]
        x = mapped(px, src.shape[2], border)[0]
        write(src, y, x, border, cval, i, j, dst)

    return pixel
