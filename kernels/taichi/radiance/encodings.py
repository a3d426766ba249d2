"""Encodings of directions and positions, in Taichi."""

import math

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

from ._harmonics import harmonics

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.kernel
def _spherical(
    directions: f32_2,  # (R, 3)
    rays: i32_1,  # (M,)
    total: i32_1,  # (1,)
    column: ti.i32,
    # outputs
    features: f32_2,  # (M, >= column + 16)
):
    for i in range(ti.min(total[0], features.shape[0])):
        ray = rays[i]
        h = harmonics(directions[ray, 0], directions[ray, 1], directions[ray, 2])
        for k in ti.static(range(16)):
            features[i, column + k] = h[k]


@primitive
def spherical(
    directions: np.ndarray, rays: np.ndarray, total: np.ndarray, column: int, features: np.ndarray
) -> None:
    """Write the spherical harmonics of the direction of each sample's ray, in 16 columns.

    `directions` (R, 3) are unit vectors, and `rays` (M,) are the rays of the first `total` (1,)
    samples. `features` (M, >= column + 16) is filled, beginning at `column`.
    """
    _spherical(directions, rays, total, column, features)


@ti.kernel
def _spherical_harmonics(
    directions: f32_2,  # (N, 3)
    # outputs
    values: f32_2,  # (N, C)
):
    for i in range(values.shape[0]):
        h = harmonics(directions[i, 0], directions[i, 1], directions[i, 2])
        for k in ti.static(range(16)):
            if k < values.shape[1]:
                values[i, k] = h[k]


@primitive
def spherical_harmonics(directions: np.ndarray, values: np.ndarray) -> None:
    """Write the first C <= 16 spherical harmonics of N unit vectors (N, 3) to `values` (N, C)."""
    _spherical_harmonics(directions, values)


@ti.func
def _turn(value: ti.f32) -> ti.f32:
    """Return `value` minus a multiple of 2, in [-1, 1) or -2; exact, except -1 for 1 - 2^-24."""
    return value - 2.0 * ti.floor(0.5 * value + 0.5)


@ti.kernel
def _positional(
    points: f32_2,  # (N, D)
    total: i32_1,  # (1,)
    frequencies: ti.i32,
    include_input: ti.i32,
    constant: ti.i32,
    column: ti.i32,
    behind: ti.i32,
    # outputs
    features: f32_2,  # (N, >= behind)
):
    for i in range(ti.min(total[0], features.shape[0])):
        at = column
        if include_input != 0:
            for d in range(points.shape[1]):
                features[i, at] = points[i, d]
                at += 1
        for d in range(points.shape[1]):
            value = points[i, d]
            for _ in range(frequencies):
                angle = math.pi * _turn(value)
                features[i, at] = ti.sin(angle)
                features[i, at + 1] = ti.cos(angle)
                value *= 2.0
                at += 2
        if constant != 0:
            features[i, at] = 1.0
            at += 1
        for rest in range(at, behind):
            features[i, rest] = 0.0


@primitive
def positional(
    points: np.ndarray,
    total: np.ndarray,
    frequencies: int,
    include_input: bool,
    constant: bool,
    column: int,
    width: int,
    features: np.ndarray,
) -> None:
    """Write sines and cosines of 2^k pi x, k < `frequencies`, for each coordinate x of `points`.

    For the first `total` (1,) of N points, (N, D), write sine and cosine of each k, coordinate by
    coordinate [Mildenhall et al. 2020, equation 4]. With `include_input` the coordinates come
    first; with `constant` a 1 comes last. The `width` columns of `features` begin at `column`; the
    rest of them is 0.
    """
    _positional(
        points, total, frequencies, include_input, constant, column, column + width, features
    )


@ti.kernel
def _gather(
    table: f32_2,  # (R, C)
    rows: i32_1,  # (M,)
    total: i32_1,  # (1,)
    column: ti.i32,
    # outputs
    features: f32_2,  # (M, >= column + C)
):
    for i in range(ti.min(total[0], features.shape[0])):
        row = rows[i]
        for k in range(table.shape[1]):
            features[i, column + k] = table[row, k]


@primitive
def gather(
    table: np.ndarray, rows: np.ndarray, total: np.ndarray, column: int, features: np.ndarray
) -> None:
    """``features[:, column:column + C] = table[rows]`` for the first `total` (1,) of `rows` (M,).

    `table` (R, C) has the dtype of `features`.
    """
    _gather(table, rows, total, column, features)
