"""Rays through a grid of density and colour on CUDA: one warp per ray.

rays.py says what is computed. The lanes of a warp are 32 positions along the ray, empty or not.
Those that are not empty are then processed four (or eight) at a time: eight (or four) lanes read
rows of the grid for one position, or add to them, four coefficients each.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.radiance import MOST_LOG_DENSITY
from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance import _fixed_point
from cvkern.kernels.warp.radiance._structs import NATIVE, Composited, Grid, March, Rays, Space

from ._march import jitter_of

OPTIONS = {"enable_backward": False}
wp.set_module_options(OPTIONS)

THREADS = 32  # threads of a ray
BLOCK = 64  # threads of a block; few, because rays differ in length
BOUNDS = BLOCK, 10  # more blocks at a time would not have enough registers
WALK = {"MOST_LOG_DENSITY": f"{MOST_LOG_DENSITY}f", **NATIVE}


@wp.func_native("return blockIdx.x * (blockDim.x / 32) + threadIdx.x / 32;")
def warp_number() -> int:
    """Return `wp.tid() // 32`, in fewer instructions."""
    ...


@_native.func_native("_rays_cuda.cu", **WALK)
def walk_forward(
    ray: int,
    jitter: float,
    rays: Rays,
    space: Space,
    march: March,
    grid: Grid,
    stop: float,
    seen: Composited,
    samples: wp.array[int],
): ...


@wp.kernel(launch_bounds=BOUNDS)
def render(
    rays: Rays,
    space: Space,
    march: March,
    grid: Grid,
    stop: float,
    # outputs
    seen: Composited,
    samples: wp.array[int],  # (R,)
):
    ray = warp_number()
    if ray < rays.active[0]:
        walk_forward(ray, jitter_of(march, ray), rays, space, march, grid, stop, seen, samples)
    else:
        samples[ray] = 0


@cache
def render_backward(sums: Any) -> wp.Kernel:
    """Return the kernel that adds to float32 numbers, or to fixed-point numbers in int64."""
    kind = {"FIXED": int(sums is wp.int64), **_fixed_point.NATIVE}

    @_native.func_native("_rays_back_cuda.cu", **kind, **WALK)
    def walk_backward(
        ray: int,
        jitter: float,
        d_seen: Composited,
        rays: Rays,
        space: Space,
        march: March,
        grid: Grid,
        stop: float,
        seen: Composited,
        d_density: wp.array3d[sums],
        d_color: wp.array4d[sums],
        touched: wp.array3d[wp.uint8],
    ): ...

    @wp.kernel(launch_bounds=BOUNDS, module="unique", module_options=OPTIONS)
    def render_backward(
        d_seen: Composited,
        rays: Rays,
        space: Space,
        march: March,
        grid: Grid,
        stop: float,
        seen: Composited,
        samples: wp.array[int],  # (R,)
        # outputs
        d_density: wp.array3d[sums],  # added to
        d_color: wp.array4d[sums],  # added to
        touched: wp.array3d[wp.uint8],
    ):
        ray = warp_number()
        if ray < rays.active[0]:
            if samples[ray] > 0:
                walk_backward(
                    ray, jitter_of(march, ray), d_seen, rays, space, march, grid, stop, seen,
                    d_density, d_color, touched,
                )  # fmt: skip

    return render_backward
