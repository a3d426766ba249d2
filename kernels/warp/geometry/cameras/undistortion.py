"""Images without the bend of a lens, in Warp: the map and the sample in one kernel.

A pixel of the result has the ray ``(x, y, z) = M (column, row, 1)`` of the old camera. Its lens
bends (x, y) / z by Brown's polynomial (cvkern/geometry/cameras/lens.py) [D. Brown, "Close-range
camera calibration", Photogrammetric Engineering 37(8), 1971], and the four pixels around that place
are weighed linearly, for bytes in steps of 1/256 pixel. On CUDA a thread takes a pixel, on
the CPU a slab of rows (_undistortion_cpu.h).
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch_each, launch_slabs, slabs

OPTIONS = {"enable_backward": False, "fuse_fp": False}
NAMES = {wp.uint8: "wp::uint8", wp.float32: "float"}


def sample(src: wp.array, numbers: wp.array, cval: float, dst: wp.array) -> None:
    """Sample an image (H, W, C) where rays of another camera are seen; one thread a pixel.

    `numbers` are a matrix (9), from (column, row, 1) of the result to rays of the old camera; then
    fx, fy, cx, cy, k1, k2, p1, p2, k3 of that; and the square of the radius beyond which the lens
    shows nothing.
    """
    if dst.device.is_cuda:
        count = dst.shape[0] * dst.shape[1]
        launch_each(sample_kernel(src.dtype), count, dst.size, [src, numbers, cval], [dst])
        return
    rows = dst.shape[0]
    parts = slabs(rows, 8 * dst.shape[0] * dst.shape[1])
    launch_slabs(sample_rows_cpu(src.dtype, dst.shape[2]), rows, parts, [src, numbers, cval], [dst])


@lru_cache
def sample_rows_cpu(scalar: Any, channels: int) -> wp.Kernel:
    """Make the kernel for the CPU: a row at a time, the map of 256 pixels as vectors."""
    native = _native.func_native(
        "_undistortion_cpu.h",
        BYTES=int(scalar is wp.uint8),
        SCALAR=NAMES[scalar],
        CHANNELS=channels,
    )

    @native
    def sample_row(
        i: int,
        src: wp.array3d[scalar],
        numbers: wp.array[float],
        cval: float,
        dst: wp.array3d[scalar],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def sample_rows(
        slab: int,
        first: int,
        last: int,
        src: wp.array3d[scalar],
        numbers: wp.array[float],
        cval: float,
        # outputs
        dst: wp.array3d[scalar],
    ):
        for i in range(first, last):
            sample_row(i, src, numbers, cval, dst)

    return sample_rows


@lru_cache
def sample_kernel(scalar: Any) -> wp.Kernel:
    """Make the kernel that samples arrays of `scalar`, a pixel at a time."""
    byte = scalar is wp.uint8

    @wp.kernel(module="unique", module_options=OPTIONS)
    def sample_pixels(
        stride: int,
        first: int,
        last: int,
        src: wp.array3d[scalar],  # (H, W, C)
        numbers: wp.array[float],  # (19,)
        cval: float,
        # outputs
        dst: wp.array3d[scalar],  # (H', W', C)
    ):
        columns = dst.shape[1]
        height = src.shape[0]
        width = src.shape[1]
        for item in range(first + wp.tid(), last, stride):
            row = item // columns
            column = item - row * columns
            i = float(row)
            j = float(column)
            z = numbers[6] * j + (numbers[7] * i + numbers[8])
            w = 1.0 / z
            x = (numbers[0] * j + (numbers[1] * i + numbers[2])) * w
            y = (numbers[3] * j + (numbers[4] * i + numbers[5])) * w
            xx = x * x
            yy = y * y
            xy = x * y
            r2 = xx + yy
            radial = 1.0 + r2 * (numbers[13] + r2 * (numbers[14] + r2 * numbers[17]))
            p1 = numbers[15]
            p2 = numbers[16]
            u = numbers[9] * (x * radial + (2.0 * (p1 * xy) + p2 * (r2 + 2.0 * xx))) + numbers[11]
            v = numbers[10] * (y * radial + (p1 * (r2 + 2.0 * yy) + 2.0 * (p2 * xy))) + numbers[12]
            inside = z > 0.0 and r2 < numbers[18] and u >= 0.0 and v >= 0.0
            if inside and u <= float(width - 1) and v <= float(height - 1):
                if wp.static(byte):
                    ix = int(u * 256.0 + 0.5)
                    iy = int(v * 256.0 + 0.5)
                    x0 = wp.min(ix >> 8, width - 2)
                    y0 = wp.min(iy >> 8, height - 2)
                    wx = ix - (x0 << 8)
                    wy = iy - (y0 << 8)
                    for c in range(dst.shape[2]):
                        a = int(src[y0, x0, c])
                        b = int(src[y0 + 1, x0, c])
                        top = (a << 8) + wx * (int(src[y0, x0 + 1, c]) - a)
                        low = (b << 8) + wx * (int(src[y0 + 1, x0 + 1, c]) - b)
                        dst[row, column, c] = scalar(((top << 8) + wy * (low - top) + 32768) >> 16)
                else:
                    x0 = wp.min(int(u), width - 2)
                    y0 = wp.min(int(v), height - 2)
                    fx = u - float(x0)
                    fy = v - float(y0)
                    for c in range(dst.shape[2]):
                        a = float(src[y0, x0, c])
                        b = float(src[y0 + 1, x0, c])
                        top = a + fx * (float(src[y0, x0 + 1, c]) - a)
                        low = b + fx * (float(src[y0 + 1, x0 + 1, c]) - b)
                        dst[row, column, c] = scalar(top + fy * (low - top))
            else:
                outside = cval
                if wp.static(byte):
                    outside = wp.clamp(cval, 0.0, 255.0) + 0.5
                for c in range(dst.shape[2]):
                    if wp.static(byte):
                        dst[row, column, c] = scalar(int(outside))
                    else:
                        dst[row, column, c] = scalar(outside)

    return sample_pixels
