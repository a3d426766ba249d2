"""Tiles of images that are seen through a homography, or at given places, on the CPU."""

from typing import Any

import warp as wp

from cvkern.kernels.codes.transform import MIDDLE, PLACE_BITS, START, START_HIGH
from cvkern.kernels.warp import _native

FEW = (1, 3, 4)  # channels that have kernels of their own
TALL, PART = wp.constant(32), wp.constant(128)  # rows and columns of a tile


def native_tile(scalar: Any, result: Any, channels: int, order: int, mapped: bool) -> wp.Function:
    """Return the native function of a tile, whose places are given, or those of a homography."""
    source: Any = wp.array3d[float] if mapped else wp.array[wp.float64]

    @_native.func_native(
        "_projective_cpu.h",
        MAPPED=int(mapped),
        NEAREST=int(order == 0),
        ROUNDED=int(result is wp.uint8),
        CHANNELS=channels,
        PART=PART,
        PLACE_BITS=PLACE_BITS,
        MIDDLE=MIDDLE,
        START=START,
        START_HIGH=START_HIGH,
    )
    def warp_tile(
        top: int,
        bottom: int,
        start: int,
        slab: int,
        src: wp.array4d[scalar],
        places: source,
        constant: int,
        cval: float,
        left: wp.array2d[int],
        dst: wp.array4d[result],
    ) -> int: ...

    return warp_tile
