"""Lights of photographs as numbers that a perceptron is given, sums of their gradients, in Warp.

The samples of a ray have the light of its photograph. The gradient by a light is a sum over the
samples of each ray, in their order, then over the rays of its photograph, so that it is the same in
every run: ray r is in part r mod P of P parts; the rays of a part are added in their order, and
then the parts.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False})
OPTIONS = {"enable_backward": False}


@cache
def gatherer(scalar: Any) -> wp.Kernel:
    """Return the kernel of :func:`gather` for a dtype of features."""

    @wp.kernel(module="unique", module_options=OPTIONS)
    def gather(
        stride: int,
        first: int,
        last: int,
        table: wp.array2d[float],  # (N, C)
        views: wp.array[int],  # (R,)
        rays: wp.array[int],  # (M,)
        total: wp.array[int],  # (1,)
        column: int,
        # outputs
        features: wp.array2d[scalar],  # (M, >= column + C)
    ):
        for i in range(first + wp.tid(), wp.min(last, total[0]), stride):
            view = views[rays[i]]
            for k in range(table.shape[1]):
                features[i, column + k] = scalar(table[view, k])

    return gather


def gather(
    table: wp.array,
    views: wp.array,
    rays: wp.array,
    total: wp.array,
    column: int,
    features: wp.array,
) -> None:
    """``features[:, column:column + C] = table[views[rays]]`` for the first `total` (1,) samples.

    `table` (N, C) float32 has the lights, `views` (R,) the photographs of rays, and `rays` (M,)
    the rays of samples. `features` may be float16.
    """
    count, width = features.shape[0], table.shape[1]
    given = [table, views, rays, total, column]
    launch_each(gatherer(features.dtype), count, width * count, given, [features])


@cache
def copier(scalar: Any) -> wp.Kernel:
    """Return the kernel of :func:`copy` for a dtype of features."""

    @wp.kernel(module="unique", module_options=OPTIONS)
    def copy(
        stride: int,
        first: int,
        last: int,
        features: wp.array2d[scalar],  # (M, >= column + C)
        total: wp.array[int],  # (1,)
        column: int,
        # outputs
        found: wp.array2d[float],  # (M, C)
    ):
        for i in range(first + wp.tid(), wp.min(last, total[0]), stride):
            for k in range(found.shape[1]):
                found[i, k] = float(features[i, column + k])

    return copy


def copy(features: wp.array, total: wp.array, column: int, found: wp.array) -> None:
    """``found = features[:, column:column + C]`` for the first `total` (1,) rows of (M, C).

    `features` may be float16.
    """
    count, width = found.shape
    given = [features, total, column]
    launch_each(copier(features.dtype), count, width * count, given, [found])


@wp.kernel
def ray_kernel(
    stride: int,
    first: int,
    last: int,
    d_samples: wp.array2d[float],  # (M, C)
    spans: wp.array2d[int],  # (R, 2)
    active: wp.array[int],  # (1,)
    # outputs
    d_rays: wp.array2d[float],  # (R, C)
):
    """Add the gradients of a ray's samples by one number."""
    width = d_rays.shape[1]
    for item in range(first + wp.tid(), last, stride):
        ray = item // width
        k = item - ray * width
        total = float(0.0)
        if ray < active[0]:
            for i in range(spans[ray, 0], spans[ray, 0] + spans[ray, 1]):
                total += d_samples[i, k]
        d_rays[ray, k] = total


def sum_rays(d_samples: wp.array, spans: wp.array, active: wp.array, d_rays: wp.array) -> None:
    """Sum rows (M, C) over the samples of each ray.

    `spans` (R, 2) have the first sample of a ray and the number of its samples. `d_rays` (R, C) is
    0 for all but the first `active` (1,) rays.
    """
    count = int(d_rays.size)
    launch_each(ray_kernel, count, 32 * count, [d_samples, spans, active], [d_rays])


@wp.kernel
def part_kernel(
    stride: int,
    first: int,
    last: int,
    d_rays: wp.array2d[float],  # (R, C)
    views: wp.array[int],  # (R,)
    active: wp.array[int],  # (1,)
    # outputs
    parts: wp.array3d[float],  # (P, N, C)
):
    """Add the gradients of a photograph's rays in one part."""
    images = parts.shape[1]
    for item in range(first + wp.tid(), last, stride):
        part = item // images
        view = item - part * images
        for k in range(parts.shape[2]):
            parts[part, view, k] = 0.0
        for ray in range(part, wp.min(active[0], views.shape[0]), parts.shape[0]):
            if views[ray] == view:
                for k in range(parts.shape[2]):
                    parts[part, view, k] = parts[part, view, k] + d_rays[ray, k]


@wp.kernel
def total_kernel(
    stride: int,
    first: int,
    last: int,
    parts: wp.array3d[float],  # (P, N, C)
    # outputs
    d_table: wp.array2d[float],  # (N, C)
):
    """Add the parts of a number."""
    width = d_table.shape[1]
    for item in range(first + wp.tid(), last, stride):
        view = item // width
        k = item - view * width
        total = float(0.0)
        for part in range(parts.shape[0]):
            total += parts[part, view, k]
        d_table[view, k] = total


def sum_views(
    d_rays: wp.array, views: wp.array, active: wp.array, parts: wp.array, d_table: wp.array
) -> None:
    """Sum rows (R, C) of the first `active` (1,) rays by their photographs `views` (R,).

    `parts` (P, N, C) is working memory; `d_table` (N, C) is filled.
    """
    count = parts.shape[0] * parts.shape[1]
    work = parts.shape[1] * views.shape[0]
    launch_each(part_kernel, count, work, [d_rays, views, active], [parts])
    sum_parts(parts, d_table)


def sum_parts(parts: wp.array, d_table: wp.array) -> None:
    """``d_table = parts.sum(axis=0)``, (N, C) of (P, N, C), part by part."""
    count = int(d_table.size)
    launch_each(total_kernel, count, parts.shape[0] * count, [parts], [d_table])
