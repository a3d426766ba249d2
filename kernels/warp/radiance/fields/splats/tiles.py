"""Splats composited tile by tile, in Warp; the Taichi set has the equations.

On the CPU a vector holds a row of a tile; plain Warp takes a pixel after the other. On CUDA a block
takes a tile.
"""

from functools import cache

import warp as wp

from cvkern.kernels.codes import radiance
from cvkern.kernels.codes import splats as codes
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, launch_slabs, slabs
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance._structs import Seen

from . import _tiles_cuda as cuda
from ._structs import Tiles

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TILE = codes.TILE
FEW = 4  # slabs a thread, since some tiles have far more splats than others
_RULES = {
    "TILE": TILE,
    "SHOWN": codes.SHOWN,
    "FAINT": f"{codes.FAINT:.9g}f",
    "MOST": f"{codes.MOST:.9g}f",
    "Tiles": Tiles.native_name,
    "Seen": Seen.native_name,
}


@cache
def _kernels() -> tuple[wp.Kernel, wp.Kernel]:
    """Return the kernels of the CPU."""

    @_native.each("_tiles_cpu.h", **_RULES)
    def composite_tile(
        tile: int,
        tiles: Tiles,
        seen: Seen,
    ): ...

    @_native.each("_tiles_cpu.h", SLOPES=codes.SLOPES, **_RULES)
    def trace_tile(
        tile: int,
        d_seen: Seen,
        tiles: Tiles,
        seen: Seen,
        slopes: wp.array2d[float],
    ): ...

    return composite_tile, trace_tile


def composite(tiles: codes.Tiles, seen: radiance.Seen) -> None:
    """Composite all pixels of a picture."""
    count = tiles.ranges.shape[0] - 1
    inputs, outputs = [struct_of(Tiles, tiles)], [struct_of(Seen, seen)]
    if tiles.ranges.device.is_cuda:
        launch(cuda.composite, count * TILE * TILE, inputs, outputs, TILE * TILE)
        return
    launch_slabs(_kernels()[0], count, _slabs(count), inputs, outputs)


def _slabs(tiles: int) -> int:
    """Return the number of slabs for so many tiles."""
    number = slabs(tiles, tiles * 2**14)
    return number if number == 1 else min(FEW * number, tiles)


def composite_backward(
    d_seen: radiance.Seen, tiles: codes.Tiles, seen: radiance.Seen, slopes: wp.array
) -> None:
    """Compute the gradients of entries by the first numbers of `shown`, `slopes` (E, 9).

    `d_seen` are gradients by colours and opacities of `seen`; depths have none. The end of a ray is
    treated as constant.
    """
    count = tiles.ranges.shape[0] - 1
    inputs = [struct_of(Seen, d_seen), struct_of(Tiles, tiles), struct_of(Seen, seen)]
    if slopes.device.is_cuda:
        launch(cuda.trace, count * TILE * TILE, inputs, [slopes], TILE * TILE)
        return
    launch_slabs(_kernels()[1], count, _slabs(count), inputs, [slopes])
