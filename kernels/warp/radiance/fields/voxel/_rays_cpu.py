"""Rays through a grid of density and colour on the CPU: one thread per slab of rays.

rays.py says what is computed. A ray is walked 16 samples at a time: first their positions, then
their densities, then, for visible samples, the rows of colour coefficients at the corners of their
cells, which are vectors.
"""

from functools import cache
from typing import NamedTuple

import warp as wp

from cvkern.kernels.codes.radiance import MOST_LOG_DENSITY
from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance._structs import NATIVE, Composited, Grid, March, Rays, Space

from ._march import jitter_of

wp.set_module_options({"enable_backward": False})

# Numbers of a sample that are stored between the two parts of the backward pass: its cell, its
# position in the cell (3), and the gradients by its raw density and by the sums of harmonics (3).
RECORD = 8


class Kernels(NamedTuple):
    """The kernels for rows of one width."""

    render: wp.Kernel
    trace: wp.Kernel
    scatter: wp.Kernel


@cache
def kernels(width: int) -> Kernels:
    """Return the kernels for rows of `width` colour coefficients."""
    walk = {"WIDTH": width, "MOST_LOG_DENSITY": f"{MOST_LOG_DENSITY}f", **NATIVE}

    @_native.func_native("_rays_cpu.h", **walk)
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

    @_native.func_native("_rays_cpu.h", RECORD=RECORD, **walk)
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
        begin: int,
        room: int,
        records: wp.array2d[float],
    ): ...

    @_native.func_native("_scatter_cpu.h", WIDTH=width, RECORD=RECORD)
    def scatter_ray(
        ray: int,
        owner: int,
        owners: int,
        directions: wp.array2d[float],
        basis: int,
        begin: int,
        room: int,
        records: wp.array2d[float],
        d_density: wp.array3d[float],
        d_color: wp.array4d[float],
        touched: wp.array3d[wp.uint8],
    ): ...

    @wp.kernel
    def render(
        slab: int,
        first: int,
        last: int,
        rays: Rays,
        space: Space,
        march: March,
        grid: Grid,
        stop: float,
        # outputs
        seen: Composited,
        samples: wp.array[int],  # (R,)
    ):
        for ray in range(first, last):
            if ray < rays.active[0]:
                jitter = jitter_of(march, ray)
                walk_forward(ray, jitter, rays, space, march, grid, stop, seen, samples)
            else:
                samples[ray] = 0

    @wp.kernel
    def trace(
        slab: int,
        first: int,
        last: int,
        d_seen: Composited,
        rays: Rays,
        space: Space,
        march: March,
        grid: Grid,
        stop: float,
        seen: Composited,
        ends: wp.array[wp.int64],  # (R,): of the records of each ray
        # outputs
        records: wp.array2d[float],  # (M, 8)
    ):
        for ray in range(first, last):
            begin = int(0)
            if ray > 0:
                begin = int(ends[ray - 1])
            room = int(ends[ray]) - begin
            if room > 0:
                jitter = jitter_of(march, ray)
                walk_backward(
                    ray, jitter, d_seen, rays, space, march, grid, stop, seen, begin, room, records
                )

    @wp.kernel
    def scatter(
        slab: int,
        first: int,
        last: int,
        owners: int,
        directions: wp.array2d[float],  # (R, 3)
        basis: int,
        ends: wp.array[wp.int64],  # (R,)
        records: wp.array2d[float],  # (M, 8)
        # outputs
        d_density: wp.array3d[float],  # added to
        d_color: wp.array4d[float],  # added to
        touched: wp.array3d[wp.uint8],
    ):
        for owner in range(first, last):
            begin = int(0)
            for ray in range(ends.shape[0]):
                room = int(ends[ray]) - begin
                if room > 0:
                    scatter_ray(
                        ray, owner, owners, directions, basis, begin, room, records, d_density,
                        d_color, touched,
                    )  # fmt: skip
                begin = int(ends[ray])

    return Kernels(render, trace, scatter)
