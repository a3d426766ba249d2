"""Rays through planes of 8 bits on CUDA: a thread takes a ray, a block 32 x 8 rays of a picture.

Parts of planes that are empty are found when the planes are first rendered, in squares of TILE
texels. The GPU's own units for textures were tried and took 1.3 times as long.
"""

import weakref

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp.radiance._structs import Rays, Seen

from ._path import FIRST, SIDEWAYS, Path, path_of

wp.set_module_options({"enable_backward": False})

MOST = 512  # most planes
TILE = wp.constant(16)
WIDE, HIGH = wp.constant(32), wp.constant(8)  # rays of a block, if they are those of a picture
_CONSTANTS = {
    "FIRST": FIRST, "SIDEWAYS": f"{SIDEWAYS!r}f", "MOST": MOST, "TILE": TILE, "TOGETHER": 4,
    "Path": Path.native_name, "Seen": Seen.native_name,
}  # fmt: skip


_filled: dict[int, wp.array] = {}  # by the identity of the array of texels


def filled_of(texels: wp.array) -> wp.array:
    """Return whether squares of texels (D, H, W) uint32, which do not change, have something.

    The result is kept as long as the texels, (D, h, w) uint8. A square that is followed by texels
    that are not 0 has something, too, because samples between the two read both.
    """
    found = _filled.get(id(texels))
    if found is None:
        count, height, width = texels.shape
        tiles = count, -(-height // int(TILE)), -(-width // int(TILE))
        found = _filled[id(texels)] = wp.empty(tiles, dtype=wp.uint8, device=texels.device)
        launch(fill, tiles, [texels], [found])
        weakref.finalize(texels, _filled.pop, id(texels), None).atexit = False
    return found


@wp.kernel
def fill(
    texels: wp.array3d[wp.uint32],  # (D, H, W)
    # outputs
    filled: wp.array3d[wp.uint8],  # (D, h, w)
):
    """Look for something in a square of texels, and in the next row and column."""
    plane, i, j = wp.tid()
    some = wp.uint32(0)
    for row in range(i * TILE, wp.min((i + 1) * TILE + 1, texels.shape[1])):
        for column in range(j * TILE, wp.min((j + 1) * TILE + 1, texels.shape[2])):
            some = some | texels[plane, row, column]
    filled[plane, i, j] = wp.uint8(0)
    if some != wp.uint32(0):
        filled[plane, i, j] = wp.uint8(1)


@_native.func_native("_rays_cuda.cu", **_CONSTANTS)
def walk(
    active: bool,
    ray: int,
    path: Path,
    planes: wp.array[float],
    texels: wp.array3d[wp.uint32],
    filled: wp.array3d[wp.uint8],
    stop: float,
    seen: Seen,
): ...


@wp.kernel
def render_bytes(
    count: int,
    row: int,  # rays of a row of the picture
    rays: Rays,
    planes: wp.array[float],  # (16 + D,)
    texels: wp.array3d[wp.uint32],  # (D, H, W)
    filled: wp.array3d[wp.uint8],  # (D, h, w)
    stop: float,
    # outputs
    seen: Seen,
):
    """Composite a ray; all threads of a block come here."""
    i = wp.tid()
    inside = i < count
    if row > 0:
        block = i // (WIDE * HIGH)
        beside = (row + WIDE - 1) // WIDE
        column = block % beside * WIDE + i % WIDE
        i = (block // beside * HIGH + i // WIDE % HIGH) * row + column
        inside = i < count and column < row
    ray = wp.clamp(i, 0, count - 1)
    active = inside and ray < rays.active[0]
    path = path_of(planes, rays, ray)
    walk(active, ray, path, planes, texels, filled, stop, seen)


def threads(count: int, row: int) -> int:
    """Return the number of threads for `count` rays, in rows of `row` if that is not 0."""
    block = int(WIDE) * int(HIGH)
    if row == 0:
        return -(-count // block) * block
    return -(-row // int(WIDE)) * -(-count // (row * int(HIGH))) * block
