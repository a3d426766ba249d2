"""Rays through planes of 8 bits on CUDA: a thread takes a ray, a block 32 x 8 rays of a picture.

The units for textures interpolate. A plane is copied to a texture when it is first rendered, and
the copy is kept as long as the array of texels. Parts of planes that are empty are found then, in
squares of TILE texels.
"""

import weakref
from typing import NamedTuple

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


class Stack(NamedTuple):
    """What is kept of planes."""

    images: list[wp.Texture2D]
    textures: wp.array
    """Their handles, (D,) uint64."""
    filled: wp.array
    """Whether a square has a texel that is not 0, or a neighbour behind it, (D, h, w) uint8."""


_stacks: dict[int, Stack] = {}  # by the identity of the array of texels


def stack_of(texels: wp.array) -> Stack:
    """Return what is kept of texels (D, H, W) uint32, which do not change."""
    found = _stacks.get(id(texels))
    if found is None:
        found = _stacks[id(texels)] = _made(texels)
        weakref.finalize(texels, _stacks.pop, id(texels), None).atexit = False
    return found


def _made(texels: wp.array) -> Stack:
    count, height, width = texels.shape
    device, stride = texels.device, 4 * height * width
    images = []
    for plane in range(count):
        start = texels.ptr + plane * stride
        data = wp.array(ptr=start, dtype=wp.uint8, shape=(height, width, 4), device=device)
        image = wp.Texture2D(
            data, filter_mode=wp.TextureFilterMode.LINEAR, normalized_coords=False, device=device
        )
        images.append(image)
    textures = wp.array([image.cuda_texture for image in images], dtype=wp.uint64, device=device)
    tiles = count, -(-height // int(TILE)), -(-width // int(TILE))
    filled = wp.empty(tiles, dtype=wp.uint8, device=device)
    launch(fill, tiles, [texels], [filled])
    return Stack(images, textures, filled)


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
    textures: wp.array[wp.uint64],
    filled: wp.array3d[wp.uint8],
    height: int,
    width: int,
    stop: float,
    seen: Seen,
): ...


@wp.kernel
def render_bytes(
    count: int,
    row: int,  # rays of a row of the picture
    rays: Rays,
    planes: wp.array[float],  # (16 + D,)
    textures: wp.array[wp.uint64],  # (D,)
    filled: wp.array3d[wp.uint8],  # (D, h, w)
    height: int,
    width: int,
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
    walk(active, ray, path, planes, textures, filled, height, width, stop, seen)


def threads(count: int, row: int) -> int:
    """Return the number of threads for `count` rays, in rows of `row` if that is not 0."""
    block = int(WIDE) * int(HIGH)
    if row == 0:
        return -(-count // block) * block
    return -(-row // int(WIDE)) * -(-count // (row * int(HIGH))) * block
