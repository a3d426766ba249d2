"""Colours of a photograph's own light: an affine map for each photograph, in Taichi.

A photograph has the map c -> c + A c + b of colours, a row (A, b) of 12 numbers, row by row of the
3 x 4 matrix. Composited, the colour C of opacity O becomes C' = C + A C + b O. With gradients G by
C',

    dL/dC = G + A^T G,    dL/dO += <G, b>,    dL/dA = G C^T,    dL/db = O G.

The gradients of a photograph are added as those of :mod:`.embeddings`.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

from . import embeddings

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.kernel
def _apply(
    color: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    views: i32_1,  # (R,)
    table: f32_2,  # (N, 12)
    # outputs
    shown: f32_2,  # (R, 3)
):
    for ray in range(opacity.shape[0]):
        view = views[ray]
        found = ti.Vector([0.0, 0.0, 0.0])
        for k in ti.static(range(3)):
            found[k] = color[ray, k] + table[view, 4 * k + 3] * opacity[ray]
            for i in ti.static(range(3)):
                found[k] += table[view, 4 * k + i] * color[ray, i]
        for k in ti.static(range(3)):
            shown[ray, k] = found[k]


@primitive
def apply(
    color: np.ndarray, opacity: np.ndarray, views: np.ndarray, table: np.ndarray, shown: np.ndarray
) -> None:
    """Map composited colours (R, 3) by the rows `views` (R,) of `table` (N, 12).

    `shown` (R, 3) may be `color` itself.
    """
    _apply(color, opacity, views, table, shown)


@ti.kernel
def _sum(
    d_color: f32_2,  # (R, 3)
    color: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    views: i32_1,  # (R,)
    active: i32_1,  # (1,)
    # outputs
    parts: f32_3,  # (P, N, 12)
):
    for part, view in ti.ndrange(parts.shape[0], parts.shape[1]):
        for k in range(12):
            parts[part, view, k] = 0.0
        ray = part
        while ray < ti.min(active[0], views.shape[0]):
            if views[ray] == view:
                for k in ti.static(range(3)):
                    for i in ti.static(range(3)):
                        parts[part, view, 4 * k + i] += d_color[ray, k] * color[ray, i]
                    parts[part, view, 4 * k + 3] += d_color[ray, k] * opacity[ray]
            ray += parts.shape[0]


@ti.kernel
def _back(
    views: i32_1,  # (R,)
    table: f32_2,  # (N, 12)
    active: i32_1,  # (1,)
    # outputs
    d_color: f32_2,  # (R, 3): of the mapped colour, then of the colour
    d_opacity: f32_1,  # (R,): added to
):
    for ray in range(ti.min(active[0], d_opacity.shape[0])):
        view = views[ray]
        g = ti.Vector([d_color[ray, 0], d_color[ray, 1], d_color[ray, 2]])
        for k in ti.static(range(3)):
            d_opacity[ray] += table[view, 4 * k + 3] * g[k]
            for i in ti.static(range(3)):
                d_color[ray, i] += table[view, 4 * k + i] * g[k]


@primitive
def backward(
    color: np.ndarray,
    opacity: np.ndarray,
    views: np.ndarray,
    table: np.ndarray,
    active: np.ndarray,
    d_color: np.ndarray,
    d_opacity: np.ndarray,
    parts: np.ndarray,
    d_table: np.ndarray,
) -> None:
    """Turn gradients by mapped colours, `d_color` (R, 3), into those by colours, in place.

    The other arguments are those of :func:`apply`, of which the first `active` (1,) rays count.
    `d_opacity` (R,) is added to, `d_table` (N, 12) is filled; `parts` (P, N, 12) is working memory.
    """
    _sum(d_color, color, opacity, views, active, parts)
    embeddings.sum_parts(parts, d_table)
    _back(views, table, active, d_color, d_opacity)
