"""Phases of shifted fringes, and projector coordinates from them, in Warp.

The Taichi set has the equations. All frames of a pixel are read once. On the CPU a thread decodes a
slab of rows, one row at a time; on CUDA it decodes four neighbouring pixels.
"""

import math
from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes import structured_light as codes
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, slabs
from cvkern.kernels.warp._structs import struct_of

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

TURN = 1 / (2 * math.pi)
_QUAD = 4  # pixels of a thread on CUDA


@wp.struct
class Fringes:
    """The same as `codes.Fringes`."""

    frequencies: wp.array[float]
    waves: wp.array2d[float]  # (steps, 2): sine, cosine
    size: int
    threshold: float
    joins: bool


def decode(frames: wp.array, begin: int, fringes: codes.Fringes, decoded: codes.Decoded) -> None:
    """Decode the frames of an axis, from frame `begin` on."""
    places = decoded.places
    if places.device.is_cuda:
        inputs = [frames, begin, *fringes]
        launch(_decode_cuda(frames.dtype), -(-places.size // _QUAD), inputs, decoded)
        return
    inputs = [frames, begin, struct_of(Fringes, fringes)]
    height = places.shape[0]
    work = fringes.waves.shape[0] * fringes.frequencies.size * places.size
    launch_slabs(_decode_cpu(frames.dtype), height, slabs(height, work), inputs, decoded)


def accept(columns: wp.array, rows: wp.array, threshold: float, valid: wp.array) -> None:
    """Mark the pixels whose modulation of both axes is above the threshold."""
    launch_each(_accept, valid.size, valid.size, [columns, rows, threshold], [valid])


@wp.kernel
def _accept(
    stride: int,
    first: int,
    last: int,
    columns: wp.array2d[float],  # modulations
    rows: wp.array2d[float],
    threshold: float,
    # outputs
    valid: wp.array2d[wp.uint8],
):
    for i in range(first + wp.tid(), last, stride):
        y = i // valid.shape[1]
        x = i % valid.shape[1]
        seen = columns[y, x] > threshold and rows[y, x] > threshold
        valid[y, x] = wp.where(seen, wp.uint8(1), wp.uint8(0))


@lru_cache
def _decode_cpu(scalar: Any) -> wp.Kernel:
    @_native.func_native("_phase_cpu.h", TYPE=scalar, TURN=f"{TURN!r}f")
    def decode_row(
        row: int,
        frames: wp.array3d[scalar],
        begin: int,
        frequencies: wp.array[float],
        waves: wp.array2d[float],
        size: int,
        threshold: float,
        joins: bool,
        places: wp.array2d[float],
        phases: wp.array2d[float],
        modulations: wp.array2d[float],
        valid: wp.array2d[wp.uint8],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def decode_slab(
        slab: int,
        first: int,
        last: int,
        frames: wp.array3d[scalar],  # (K, H, W)
        begin: int,
        fringes: Fringes,
        # outputs
        places: wp.array2d[float],
        phases: wp.array2d[float],
        modulations: wp.array2d[float],
        valid: wp.array2d[wp.uint8],
    ):
        for row in range(first, last):
            decode_row(
                row, frames, begin, fringes.frequencies, fringes.waves, fringes.size,
                fringes.threshold, fringes.joins, places, phases, modulations, valid,
            )  # fmt: skip

    return decode_slab


@lru_cache
def _decode_cuda(scalar: Any) -> wp.Kernel:
    @_native.kernel("_phase_cuda.cu", OPTIONS, TYPE=scalar, QUAD=_QUAD, TURN=f"{TURN!r}f")
    def decode_quad(
        frames: wp.array3d[scalar],
        begin: int,
        frequencies: wp.array[float],
        waves: wp.array2d[float],
        size: int,
        threshold: float,
        joins: bool,
        places: wp.array2d[float],
        phases: wp.array2d[float],
        modulations: wp.array2d[float],
        valid: wp.array2d[wp.uint8],
    ): ...

    return decode_quad
