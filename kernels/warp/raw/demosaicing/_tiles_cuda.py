"""Menon's demosaicing on CUDA: tiles stay in shared memory between the steps.

A first kernel finds green and the direction, a second one the colours: in one, each tile would have
to compute eleven pixels around it.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, scratch
from cvkern.kernels.warp.raw._types import constants

OPTIONS = {"enable_backward": False, "fuse_fp": False}
TALL, WIDE = 16, 64  # pixels of a tile: with what lies around it, 33 KB of shared memory
AROUND = 5  # pixels beyond the image whose green the later steps need
BLOCK = 256
MOST_BLOCKS = 2**15  # blocks take tiles in turns, so that no launch is folded


class Tiles(NamedTuple):
    """The kernels for values of one type."""

    green: wp.Kernel
    colour: wp.Kernel


def demosaic(raw: wp.array, red_row: int, red_column: int, colours: wp.array) -> None:
    """Find the colours of all pixels."""
    height, width = raw.shape
    shape = height + 2 * AROUND, width + 2 * AROUND
    green = scratch("menon.green", shape, wp.float32, raw.device)
    levels = scratch("menon.levels", shape, wp.uint8, raw.device)
    place = [raw, red_row, red_column]
    tiles = kernels(raw.dtype)
    launch(tiles.green, _threads(*shape), place, [green, levels], BLOCK)
    launch(tiles.colour, _threads(height, width), [*place, green, levels], [colours], BLOCK)


def _threads(height: int, width: int) -> int:
    return min(-(-height // TALL) * -(-width // WIDE), MOST_BLOCKS) * BLOCK


@lru_cache
def kernels(scalar: Any) -> Tiles:
    """Make the kernels for values of a type."""
    names = {"TALL": TALL, "WIDE": WIDE, "AROUND": AROUND, **constants(scalar)}

    @_native.kernel("_menon_tiles.h", OPTIONS, **names)
    def green_tiles(
        raw: wp.array2d[scalar],
        red_row: int,
        red_column: int,
        # outputs
        green: wp.array2d[float],
        levels: wp.array2d[wp.uint8],
    ):
        """Forward to the native code."""

    @_native.kernel("_menon_tiles.h", OPTIONS, **names)
    def colour_tiles(
        raw: wp.array2d[scalar],
        red_row: int,
        red_column: int,
        greens: wp.array2d[float],
        levels: wp.array2d[wp.uint8],
        # outputs
        colours: wp.array3d[scalar],
    ):
        """Forward to the native code."""

    return Tiles(green_tiles, colour_tiles)
