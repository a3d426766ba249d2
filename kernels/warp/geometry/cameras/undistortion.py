"""Images without the bend of a lens, in Warp: the map and the sample in one kernel.

A pixel of the result has the ray ``(x, y, z) = M (column, row, 1)`` of the old camera. Its lens
bends (x, y) / z by Brown's polynomial (cvkern/geometry/cameras/lens.py) [D. Brown, "Close-range
camera calibration", Photogrammetric Engineering 37(8), 1971], and the four pixels around that place
are weighed linearly, for bytes in steps of 1/256 pixel. On CUDA a warp takes 384 pixels of a row,
on the CPU a thread takes a slab of rows (_undistortion_cpu.h).
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.geometry import LENS_SEGMENT
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import BLOCK, launch, launch_slabs, slabs

OPTIONS = {"enable_backward": False, "fuse_fp": False}
# Pixels of a lane on CUDA, and of these fetched at once: anywhere, and inside the image.
STEPS, GROUP, FAST = 12, 1, 4


def sample(src: wp.array, numbers: wp.array, cval: float, dst: wp.array) -> None:
    """Sample an image (H, W, C) where rays of another camera are seen.

    `numbers` are a matrix (9), from (column, row, 1) of the result to rays of the old camera; then
    fx, fy, cx, cy, k1, k2, p1, p2, k3 of that; the square of the radius beyond which the lens
    shows nothing; and 1 where the places of `LENS_SEGMENT` pixels of a row may be a parabola.
    """
    rows, columns, channels = dst.shape
    inputs = [src, numbers, cval]
    if dst.device.is_cuda:
        # The rows of a block are neighbours, which read the same lines.
        threads = -(-rows // (BLOCK // 32)) * -(-columns // (32 * STEPS)) * BLOCK
        launch(sample_parts_cuda(src.dtype, channels), threads, inputs, [dst], BLOCK)
        return
    parts = slabs(rows, 8 * rows * columns)
    launch_slabs(sample_rows_cpu(src.dtype, channels), rows, parts, inputs, [dst])


@lru_cache
def sample_rows_cpu(scalar: Any, channels: int) -> wp.Kernel:
    """Make the kernel for the CPU: a row at a time, 256 pixels as vectors."""
    native = _native.func_native(
        "_undistortion_cpu.h",
        BYTES=int(scalar is wp.uint8),
        SCALAR=scalar,
        CHANNELS=channels,
        SEGMENT=LENS_SEGMENT,
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
def sample_parts_cuda(scalar: Any, channels: int) -> wp.Kernel:
    """Make the kernel for CUDA: a warp a part of a row."""

    @_native.kernel(
        "_undistortion_cuda.cu",
        OPTIONS,
        launch_bounds=(BLOCK, 4),
        BYTES=int(scalar is wp.uint8),
        SCALAR=scalar,
        CHANNELS=channels,
        SEGMENT=LENS_SEGMENT,
        STEPS=STEPS,
        GROUP=GROUP,
        FAST=FAST,
        ALL_FAST=sum(1 << 2 * n for n in range(FAST)),
        WARPS=BLOCK // 32,
    )
    def sample_part(
        src: wp.array3d[scalar],
        numbers: wp.array[float],
        cval: float,
        dst: wp.array3d[scalar],
    ): ...

    return sample_part
