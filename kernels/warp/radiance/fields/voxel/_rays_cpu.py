"""Rays through a grid of density and colour on the CPU: one thread a slab of rays.

What is done with a ray is C (`wp.func_native`), in _walk_cpu.py; rays.py says
what is computed.
"""

from functools import cache
from typing import NamedTuple

import warp as wp

from ._march import March, jitter_of
from ._walk_cpu import BACKWARD, FORWARD, SCATTER, WALK, text

wp.set_module_options({"enable_backward": False})


class Kernels(NamedTuple):
    """The kernels for rows of one width."""

    render: wp.Kernel
    trace: wp.Kernel
    scatter: wp.Kernel


@cache
def kernels(width: int) -> Kernels:
    """Return the kernels for rows of `width` colour coefficients."""

    @wp.func_native(text(WALK, width, FORWARD))
    def walk_forward(
        ray: int,
        jitter: float,
        origins: wp.array2d[float],
        directions: wp.array2d[float],
        march: March,
        colors: wp.array2d[float],
        opacity: wp.array[float],
        depth: wp.array[float],
        distortion: wp.array[float],
        samples: wp.array[int],
    ): ...

    @wp.func_native(text(WALK, width, BACKWARD))
    def walk_backward(
        ray: int,
        jitter: float,
        d_colors: wp.array2d[float],
        d_opacity: wp.array[float],
        d_depth: wp.array[float],
        d_distortion: wp.array[float],
        origins: wp.array2d[float],
        directions: wp.array2d[float],
        march: March,
        colors: wp.array2d[float],
        opacity: wp.array[float],
        depth: wp.array[float],
        distortion: wp.array[float],
        begin: int,
        room: int,
        records: wp.array2d[float],
    ): ...

    @wp.func_native(text(SCATTER, width, {}))
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
        origins: wp.array2d[float],  # (R, 3)
        directions: wp.array2d[float],  # (R, 3)
        active: wp.array[int],  # (1,)
        march: March,
        # outputs
        colors: wp.array2d[float],  # (R, 3)
        opacity: wp.array[float],  # (R,)
        depth: wp.array[float],  # (R,)
        distortion: wp.array[float],  # (R,)
        samples: wp.array[int],  # (R,)
    ):
        for ray in range(first, last):
            if ray < active[0]:
                walk_forward(
                    ray, jitter_of(march, ray), origins, directions, march, colors, opacity, depth,
                    distortion, samples,
                )  # fmt: skip
            else:
                samples[ray] = 0

    @wp.kernel
    def trace(
        slab: int,
        first: int,
        last: int,
        d_colors: wp.array2d[float],  # (R, 3)
        d_opacity: wp.array[float],  # (R,)
        d_depth: wp.array[float],  # (R,)
        d_distortion: wp.array[float],  # (R,)
        origins: wp.array2d[float],  # (R, 3)
        directions: wp.array2d[float],  # (R, 3)
        march: March,
        colors: wp.array2d[float],  # (R, 3)
        opacity: wp.array[float],  # (R,)
        depth: wp.array[float],  # (R,)
        distortion: wp.array[float],  # (R,)
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
                walk_backward(
                    ray, jitter_of(march, ray), d_colors, d_opacity, d_depth, d_distortion, origins,
                    directions, march, colors, opacity, depth, distortion, begin, room, records,
                )  # fmt: skip

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
