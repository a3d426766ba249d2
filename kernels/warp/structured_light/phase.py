"""Phases of shifted fringes, and projector coordinates from them, in Warp.

The Taichi set has the equations. All frames of a pixel are read once. On the CPU a thread decodes a
slab of rows, one row at a time; on CUDA it decodes one pixel.
"""

import math
from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._angles import atan2
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, slabs

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

_TYPES = {wp.uint8: "unsigned char", wp.uint16: "unsigned short", wp.float32: "float"}
TURN = wp.constant(1 / (2 * math.pi))


def decode(
    frames: wp.array,
    begin: int,
    frequencies: wp.array,
    waves: wp.array,
    size: int,
    places: wp.array,
    phases: wp.array,
    modulations: wp.array,
) -> None:
    """Decode the frames of an axis of `size` lines, from `begin` on.

    Writes the place in the axis, the phase of the last frequency, and the least modulation.
    """
    inputs = [frames, begin, frequencies, waves, size]
    outputs = [places, phases, modulations]
    if places.device.is_cuda:
        launch(_decode_cuda(frames.dtype), places.size, inputs, outputs)
        return
    height = places.shape[0]
    work = waves.shape[0] * frequencies.size * places.size
    launch_slabs(_decode_cpu(frames.dtype), height, slabs(height, work), inputs, outputs)


def accept(columns: wp.array, rows: wp.array, threshold: float, valid: wp.array) -> None:
    """Mark the pixels whose modulation of both axes is above the threshold."""
    launch_each(_accept, valid.size, valid.size, [columns, rows, threshold], [valid])


def pick(src: wp.array, step: int, dst: wp.array) -> None:
    """Take every `step`-th pixel along both sides; one thread a pixel of the result."""
    launch_each(_pick, dst.size, dst.size, [src, step], [dst])


@wp.kernel
def _pick(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[float],
    step: int,
    # outputs
    dst: wp.array2d[float],
):
    for item in range(first + wp.tid(), last, stride):
        i = item // dst.shape[1]
        j = item - i * dst.shape[1]
        dst[i, j] = src[step * i, step * j]


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
    @_native.func_native("_phase_cpu.h", TYPE=_TYPES[scalar], TURN=f"{TURN!r}f")
    def decode_row(
        row: int,
        frames: wp.array3d[scalar],
        begin: int,
        frequencies: wp.array[float],
        waves: wp.array2d[float],
        size: int,
        places: wp.array2d[float],
        phases: wp.array2d[float],
        modulations: wp.array2d[float],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS)
    def decode_slab(
        slab: int,
        first: int,
        last: int,
        frames: wp.array3d[scalar],  # (K, H, W)
        begin: int,
        frequencies: wp.array[float],
        waves: wp.array2d[float],  # (steps, 2): sine, cosine
        size: int,
        # outputs
        places: wp.array2d[float],
        phases: wp.array2d[float],
        modulations: wp.array2d[float],
    ):
        for row in range(first, last):
            decode_row(
                row, frames, begin, frequencies, waves, size, places, phases, modulations
            )  # fmt: skip

    return decode_slab


@lru_cache
def _decode_cuda(scalar: Any) -> wp.Kernel:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def decode_pixel(
        frames: wp.array3d[scalar],  # (K, H, W)
        begin: int,
        frequencies: wp.array[float],
        waves: wp.array2d[float],  # (steps, 2): sine, cosine
        size: int,
        # outputs
        places: wp.array2d[float],
        phases: wp.array2d[float],
        modulations: wp.array2d[float],
    ):
        i = wp.tid()
        y = i // places.shape[1]
        x = i % places.shape[1]
        steps = waves.shape[0]
        t = float(0.0)
        angle = float(0.0)
        least = float(wp.inf)
        seen = int(1)
        f = float(1.0)
        for j in range(frequencies.shape[0]):
            s = float(0.0)
            c = float(0.0)
            for n in range(steps):
                value = float(frames[begin + j * steps + n, y, x])
                s += value * waves[n, 0]
                c += value * waves[n, 1]
            angle = atan2(s, c)
            length = wp.sqrt(c * c + s * s)
            if not (length < wp.inf):  # NaN as well
                seen = int(0)
            modulation = 2.0 * length / float(steps)
            if modulation < least:
                least = modulation
            p = angle * TURN
            f = frequencies[j]
            k = wp.floor(f * t - p + 0.5)
            if j == 0:
                k = wp.where(p < 0.0, 1.0, 0.0)
            t = (p + k) / f
        # Noise may have moved a position across the end of the first period.
        f = frequencies[0]
        u = f * t
        t = (u - wp.floor(u)) / f
        nowhere = wp.float32(wp.nan)
        places[y, x] = wp.where(seen == 1, t * float(size) - 0.5, nowhere)
        phases[y, x] = wp.where(seen == 1, angle, nowhere)
        modulations[y, x] = wp.where(seen == 1, least, nowhere)

    return decode_pixel
