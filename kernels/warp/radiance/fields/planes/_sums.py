"""Sums of the gradients of samples for each texel and coefficient of planes, in Warp."""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.warp.radiance._fixed_point import LIMIT, UNIT
from cvkern.kernels.warp.radiance._structs import Rays

from ._path import FIRST, corner_of, path_of
from ._shine import Shine, place_of, side_of

OPTIONS = {"enable_backward": False}
wp.set_module_options(OPTIONS)

LOST = wp.constant(wp.int64(-3 * 2**61))  # a sum with a NaN, which no summands bring back


@cache
def adder(total: Any, serial: bool) -> Any:
    """Return the function that adds a gradient's share to one number of each of some channels."""
    exact = total is wp.int64

    @wp.func
    def add(sums: wp.array4d[total], plane: int, row: int, column: int, channel: int, value: float):
        if wp.static(exact):
            fixed = wp.int64(wp.rint(wp.clamp(value, -LIMIT, LIMIT) / UNIT))
            if value != value:
                wp.atomic_min(sums, plane, row, column, channel, LOST)
            else:
                wp.atomic_add(sums, plane, row, column, channel, fixed)
        elif wp.static(serial):
            sums[plane, row, column, channel] = sums[plane, row, column, channel] + value
        else:
            wp.atomic_add(sums, plane, row, column, channel, value)

    return add


@cache
def scatterer(total: Any, serial: bool) -> wp.Kernel:
    """Return the kernel that adds the gradients of samples to texels."""
    add = adder(total, serial)

    @wp.func
    def scatter_one(
        rays: Rays,
        planes: wp.array[float],  # (16 + D,)
        records: wp.array2d[wp.vec4],
        plane: int,
        ray: int,
        sums: wp.array4d[total],
    ):
        record = records[plane, ray]
        if record[0] != 0.0 or record[1] != 0.0 or record[2] != 0.0 or record[3] != 0.0:
            path = path_of(planes, rays, ray)
            at = corner_of(path, planes[FIRST + plane], sums.shape[1], sums.shape[2])
            i = at.row
            j = at.column
            for k in range(4):
                add(sums, plane, i, j, k, (1.0 - at.down) * (1.0 - at.right) * record[k])
                add(sums, plane, i, j + 1, k, (1.0 - at.down) * at.right * record[k])
                add(sums, plane, i + 1, j, k, at.down * (1.0 - at.right) * record[k])
                add(sums, plane, i + 1, j + 1, k, at.down * at.right * record[k])

    @wp.kernel(module="unique", module_options=OPTIONS)
    def by_plane(
        slab: int,
        first: int,
        last: int,
        rays: Rays,
        planes: wp.array[float],  # (16 + D,)
        records: wp.array2d[wp.vec4],  # (D, R)
        # outputs
        sums: wp.array4d[total],  # (D, H, W, 4): added to
    ):
        for plane in range(first, last):
            for ray in range(wp.min(rays.active[0], records.shape[1])):
                scatter_one(rays, planes, records, plane, ray, sums)

    @wp.kernel(module="unique", module_options=OPTIONS)
    def by_sample(
        rays: Rays,
        planes: wp.array[float],  # (16 + D,)
        records: wp.array2d[wp.vec4],  # (D, R)
        # outputs
        sums: wp.array4d[total],  # (D, H, W, 4): added to
    ):
        plane, ray = wp.tid()
        if ray < rays.active[0]:
            scatter_one(rays, planes, records, plane, ray, sums)

    return by_plane if serial else by_sample


@cache
def shine_scatterer(total: Any, serial: bool) -> wp.Kernel:
    """Return the kernel that adds the gradients of samples to coefficients."""
    add = adder(total, serial)

    @wp.func
    def scatter_one(
        rays: Rays,
        planes: wp.array[float],  # (16 + D,)
        size: wp.vec2i,
        records: wp.array2d[wp.vec4],
        weights: wp.array2d[float],
        shine: Shine,
        plane: int,
        ray: int,
        sums: wp.array4d[total],
    ):
        alpha = weights[plane, ray]
        if alpha > 0.0:
            record = records[plane, ray]
            path = path_of(planes, rays, ray)
            q = planes[FIRST + plane]
            place = place_of(shine, corner_of(path, q, size[0], size[1]))
            group = plane // shine.shared
            i = place.row
            j = place.column
            for k in range(shine.maps.shape[3]):
                value = alpha * side_of(shine, path, q, k // 3) * record[k % 3]
                upper = (1.0 - place.down) * value
                lower = place.down * value
                add(sums, group, i, j, k, (1.0 - place.right) * upper)
                add(sums, group, i, j + 1, k, place.right * upper)
                add(sums, group, i + 1, j, k, (1.0 - place.right) * lower)
                add(sums, group, i + 1, j + 1, k, place.right * lower)

    @wp.kernel(module="unique", module_options=OPTIONS)
    def by_group(
        slab: int,
        first: int,
        last: int,
        rays: Rays,
        planes: wp.array[float],  # (16 + D,)
        size: wp.vec2i,
        records: wp.array2d[wp.vec4],  # (D, R)
        weights: wp.array2d[float],  # (D, R)
        shine: Shine,
        # outputs
        sums: wp.array4d[total],  # (G, h, w, 3 N): added to
    ):
        for plane in range(first * shine.shared, wp.min(last * shine.shared, records.shape[0])):
            for ray in range(wp.min(rays.active[0], records.shape[1])):
                scatter_one(rays, planes, size, records, weights, shine, plane, ray, sums)

    @wp.kernel(module="unique", module_options=OPTIONS)
    def by_sample(
        rays: Rays,
        planes: wp.array[float],  # (16 + D,)
        size: wp.vec2i,
        records: wp.array2d[wp.vec4],  # (D, R)
        weights: wp.array2d[float],  # (D, R)
        shine: Shine,
        # outputs
        sums: wp.array4d[total],  # (G, h, w, 3 N): added to
    ):
        plane, ray = wp.tid()
        if ray < rays.active[0]:
            scatter_one(rays, planes, size, records, weights, shine, plane, ray, sums)

    return by_group if serial else by_sample
