"""Fusion of exposures on CUDA, in native code: a thread has four pixels."""

from functools import lru_cache
from typing import Any, NamedTuple

import warp as wp

from cvkern.kernels.codes import raw as codes
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import BLOCK
from cvkern.kernels.warp.raw._bands_cuda import FEWER, OPTIONS, PART
from cvkern.kernels.warp.raw._types import constants

QUICK_BLOCKS = 2  # blocks of `quick` that a multiprocessor has at once
KEPT = 4  # exposures whose weights stay in shared memory until all are known: 32 KiB


class Fusion(NamedTuple):
    """The kernels for frames of one type."""

    weigh: wp.Kernel
    begin: wp.Kernel
    quick: wp.Kernel  # the same, if rows of bytes are whole groups of four
    blend: wp.Kernel
    rest: wp.Kernel  # small levels
    finish: wp.Kernel


def names(scalar: Any, channels: int) -> dict[str, Any]:
    """Return the constants of the native code for values of a type."""
    types = constants(scalar)
    return {
        "TYPE": types["TYPE"], "INTEGRAL": types["INTEGRAL"], "CHANNELS": channels,
        "SUM": wp.int16 if types["INTEGRAL"] else wp.float32,
        "STEEP": f"{1 / codes.KNEE!r}f", "LEAST": f"{codes.LEAST!r}f",
    }  # fmt: skip


@lru_cache
def kernels(scalar: Any, channels: int) -> Fusion:
    """Make the kernels for frames of a type."""
    own = {"PART": PART, **names(scalar, channels)}
    values = {name: own[name] for name in ("TYPE", "INTEGRAL", "CHANNELS")}

    @_native.kernel(
        "_weights_cuda.cu", OPTIONS, launch_bounds=(BLOCK, 3), BLOCK=BLOCK, KEPT=KEPT,
        SUM=own["SUM"], LEAST=own["LEAST"], **values,
    )  # fmt: skip
    def weigh_block(
        frames: wp.array4d[scalar],
        scale: float,
        contrast: float,
        saturation: float,
        exposure: float,
        # outputs
        weights: wp.array3d[float],
    ):
        """Forward to the native code."""

    @_native.kernel("_reduction_cuda.cu", OPTIONS, launch_bounds=(BLOCK, 2), PART=PART, **values)
    def frame_strips(
        frames: wp.array4d[scalar],
        scale: float,
        weights: wp.array3d[float],
        each: int,
        # outputs
        dst: wp.array3d[float],
    ):
        """Forward to the native code."""

    @_native.kernel(
        "_reduction_cuda.cu", OPTIONS, launch_bounds=(BLOCK, QUICK_BLOCKS), PART=PART, **values
    )
    def byte_strips(
        frames: wp.array4d[scalar],
        scale: float,
        weights: wp.array3d[float],
        each: int,
        # outputs
        dst: wp.array3d[float],
    ):
        """Forward to the native code."""

    @_native.kernel("_fusion_cuda.cu", OPTIONS, **own)
    def blend_four(
        coarse: wp.array3d[float],
        alone: int,
        # outputs
        fine: wp.array3d[float],
    ):
        """Forward to the native code."""

    @_native.kernel("_fusion_cuda.cu", OPTIONS, launch_bounds=(FEWER, 1), **own)
    def blend_rest(
        count: int,
        # outputs
        a: wp.array3d[float],
        b: wp.array3d[float],
        c: wp.array3d[float],
        d: wp.array3d[float],
        e: wp.array3d[float],
        f: wp.array3d[float],
        g: wp.array3d[float],
    ):
        """Forward to the native code."""

    @_native.kernel("_fusion_cuda.cu", OPTIONS, launch_bounds=(BLOCK, 3), WARPS=BLOCK // 32, **own)
    def finish_four(
        frames: wp.array4d[scalar],
        scale: float,
        weights: wp.array3d[float],
        coarse: wp.array3d[float],
        alone: int,
        # outputs
        out: wp.array3d[float],
    ):
        """Forward to the native code."""

    return Fusion(weigh_block, frame_strips, byte_strips, blend_four, blend_rest, finish_four)
