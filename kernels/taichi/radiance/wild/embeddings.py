"""Lights of photographs as numbers that a perceptron is given, sums of their gradients, in Taichi.

The samples of a ray have the light of its photograph. The gradient by a light is a sum over the
samples of each ray, in their order, then over the rays of its photograph, so that it is the same in
every run: ray r is in part r mod P of P parts; the rays of a part are added in their order, and
then the parts.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)


@ti.kernel
def _gather(
    table: f32_2,  # (N, C)
    views: i32_1,  # (R,)
    rays: i32_1,  # (M,)
    total: i32_1,  # (1,)
    column: ti.i32,
    # outputs
    features: f32_2,  # (M, >= column + C)
):
    for i in range(ti.min(total[0], features.shape[0])):
        view = views[rays[i]]
        for k in range(table.shape[1]):
            features[i, column + k] = table[view, k]


@primitive
def gather(
    table: np.ndarray,
    views: np.ndarray,
    rays: np.ndarray,
    total: np.ndarray,
    column: int,
    features: np.ndarray,
) -> None:
    """``features[:, column:column + C] = table[views[rays]]`` for the first `total` (1,) samples.

    `table` (N, C) has the lights, `views` (R,) the photographs of rays, and `rays` (M,) the rays of
    samples.
    """
    _gather(table, views, rays, total, column, features)


@ti.kernel
def _copy(
    features: f32_2,  # (M, >= column + C)
    total: i32_1,  # (1,)
    column: ti.i32,
    # outputs
    found: f32_2,  # (M, C)
):
    for i in range(ti.min(total[0], found.shape[0])):
        for k in range(found.shape[1]):
            found[i, k] = features[i, column + k]


@primitive
def copy(features: np.ndarray, total: np.ndarray, column: int, found: np.ndarray) -> None:
    """``found = features[:, column:column + C]`` for the first `total` (1,) rows of (M, C)."""
    _copy(features, total, column, found)


@ti.kernel
def _sum_rays(
    d_samples: f32_2,  # (M, C)
    spans: i32_2,  # (R, 2)
    active: i32_1,  # (1,)
    # outputs
    d_rays: f32_2,  # (R, C)
):
    for ray, k in ti.ndrange(d_rays.shape[0], d_rays.shape[1]):
        total = 0.0
        if ray < active[0]:
            for i in range(spans[ray, 0], spans[ray, 0] + spans[ray, 1]):
                total += d_samples[i, k]
        d_rays[ray, k] = total


@primitive
def sum_rays(
    d_samples: np.ndarray, spans: np.ndarray, active: np.ndarray, d_rays: np.ndarray
) -> None:
    """Sum rows (M, C) over the samples of each ray.

    `spans` (R, 2) have the first sample of a ray and the number of its samples. `d_rays` (R, C) is
    0 for all but the first `active` (1,) rays.
    """
    _sum_rays(d_samples, spans, active, d_rays)


@ti.kernel
def _sum_views(
    d_rays: f32_2,  # (R, C)
    views: i32_1,  # (R,)
    active: i32_1,  # (1,)
    # outputs
    parts: f32_3,  # (P, N, C)
):
    for part, view in ti.ndrange(parts.shape[0], parts.shape[1]):
        for k in range(parts.shape[2]):
            parts[part, view, k] = 0.0
        ray = part
        while ray < ti.min(active[0], views.shape[0]):
            if views[ray] == view:
                for k in range(parts.shape[2]):
                    parts[part, view, k] += d_rays[ray, k]
            ray += parts.shape[0]


@ti.kernel
def _sum_parts(
    parts: f32_3,  # (P, N, C)
    # outputs
    d_table: f32_2,  # (N, C)
):
    for view, k in ti.ndrange(d_table.shape[0], d_table.shape[1]):
        total = 0.0
        for part in range(parts.shape[0]):
            total += parts[part, view, k]
        d_table[view, k] = total


@primitive
def sum_views(
    d_rays: np.ndarray,
    views: np.ndarray,
    active: np.ndarray,
    parts: np.ndarray,
    d_table: np.ndarray,
) -> None:
    """Sum rows (R, C) of the first `active` (1,) rays by their photographs `views` (R,).

    `parts` (P, N, C) is working memory; `d_table` (N, C) is filled.
    """
    _sum_views(d_rays, views, active, parts)
    _sum_parts(parts, d_table)


@primitive
def sum_parts(parts: np.ndarray, d_table: np.ndarray) -> None:
    """``d_table = parts.sum(axis=0)``, (N, C) of (P, N, C), part by part."""
    _sum_parts(parts, d_table)
