"""Rays through planes of 8 bits on CUDA: a thread takes a ray."""

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance._structs import Rays, Seen

from ._path import FIRST, SIDEWAYS, Path, path_of

wp.set_module_options({"enable_backward": False})

MOST = 512  # most planes
_CONSTANTS = {
    "FIRST": FIRST, "SIDEWAYS": f"{SIDEWAYS!r}f", "MOST": MOST, "TOGETHER": 4,
    "Path": Path.native_name, "Seen": Seen.native_name,
}  # fmt: skip


@_native.func_native("_rays_cuda.cu", **_CONSTANTS)
def walk(
    active: bool,
    ray: int,
    path: Path,
    planes: wp.array[float],
    texels: wp.array3d[wp.uint32],
    stop: float,
    seen: Seen,
): ...


@wp.kernel
def render_bytes(
    count: int,
    rays: Rays,
    planes: wp.array[float],  # (16 + D,)
    texels: wp.array3d[wp.uint32],  # (D, H, W)
    stop: float,
    # outputs
    seen: Seen,
):
    """Composite a ray; all threads of a block come here."""
    i = wp.tid()
    ray = wp.min(i, count - 1)
    active = i < count and ray < rays.active[0]
    walk(active, ray, path_of(planes, rays, ray), planes, texels, stop, seen)
