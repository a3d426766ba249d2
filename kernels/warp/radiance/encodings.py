"""Encodings of directions and positions, in Warp."""

import math
from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch_each

from ._harmonics import harmonics

OPTIONS = {"enable_backward": False}  # options of kernels that are made for a dtype
wp.set_module_options(OPTIONS)

PI = wp.constant(math.pi)


@cache
def _spherical(scalar: Any) -> wp.Kernel:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def spherical(
        stride: int,
        first: int,
        last: int,
        directions: wp.array2d[float],  # (R, 3)
        rays: wp.array[int],  # (M,)
        total: wp.array[int],  # (1,)
        column: int,
        # outputs
        features: wp.array2d[scalar],  # (M, >= column + 16)
    ):
        for i in range(first + wp.tid(), wp.min(last, total[0]), stride):
            ray = rays[i]
            h = harmonics(directions[ray, 0], directions[ray, 1], directions[ray, 2])
            for k in range(16):
                features[i, column + k] = scalar(h[k])

    return spherical


def spherical(
    directions: wp.array, rays: wp.array, total: wp.array, column: int, features: wp.array
) -> None:
    """Write the spherical harmonics of the direction of each sample's ray, in 16 columns.

    `directions` (R, 3) are unit vectors, and `rays` (M,) are the rays of the first `total` (1,)
    samples. `features` (M, >= column + 16) is filled, beginning at `column`.
    """
    count = features.shape[0]
    launch_each(
        _spherical(features.dtype), count, 16 * count, [directions, rays, total, column], [features]
    )


@wp.kernel
def harmonics_kernel(
    stride: int,
    first: int,
    last: int,
    directions: wp.array2d[float],  # (N, 3)
    # outputs
    values: wp.array2d[float],  # (N, C)
):
    """Write the first C harmonics of each direction."""
    for i in range(first + wp.tid(), last, stride):
        h = harmonics(directions[i, 0], directions[i, 1], directions[i, 2])
        for k in range(values.shape[1]):
            values[i, k] = h[k]


def spherical_harmonics(directions: wp.array, values: wp.array) -> None:
    """Write the first C <= 16 spherical harmonics of N unit vectors (N, 3) to `values` (N, C)."""
    count = values.shape[0]
    launch_each(harmonics_kernel, count, 16 * count, [directions], [values])


@wp.func
def turn(value: float) -> float:
    """Return `value` minus a multiple of 2, in [-1, 1) or -2; exact, except -1 for 1 - 2^-24."""
    return value - 2.0 * wp.floor(0.5 * value + 0.5)


@cache
def _positional(scalar: Any) -> wp.Kernel:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def positional(
        stride: int,
        first: int,
        last: int,
        points: wp.array2d[float],  # (N, D)
        total: wp.array[int],  # (1,)
        frequencies: int,
        include_input: bool,
        constant: bool,
        column: int,
        behind: int,
        # outputs
        features: wp.array2d[scalar],  # (N, >= behind)
    ):
        for i in range(first + wp.tid(), wp.min(last, total[0]), stride):
            at = column
            if include_input:
                for d in range(points.shape[1]):
                    features[i, at] = scalar(points[i, d])
                    at += 1
            for d in range(points.shape[1]):
                value = points[i, d]
                for _k in range(frequencies):
                    angle = PI * turn(value)
                    features[i, at] = scalar(wp.sin(angle))
                    features[i, at + 1] = scalar(wp.cos(angle))
                    value *= 2.0
                    at += 2
            if constant:
                features[i, at] = scalar(1.0)
                at += 1
            for rest in range(at, behind):
                features[i, rest] = scalar(0.0)

    return positional


@cache
def _gather(scalar: Any) -> wp.Kernel:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def gather(
        stride: int,
        first: int,
        last: int,
        table: wp.array2d[scalar],  # (R, C)
        rows: wp.array[int],  # (M,)
        total: wp.array[int],  # (1,)
        column: int,
        # outputs
        features: wp.array2d[scalar],  # (M, >= column + C)
    ):
        for i in range(first + wp.tid(), wp.min(last, total[0]), stride):
            row = rows[i]
            for k in range(table.shape[1]):
                features[i, column + k] = table[row, k]

    return gather


def positional(
    points: wp.array,
    total: wp.array,
    frequencies: int,
    include_input: bool,
    constant: bool,
    column: int,
    width: int,
    features: wp.array,
) -> None:
    """Write sines and cosines of 2^k pi x, k < `frequencies`, for each coordinate x of `points`.

    For the first `total` (1,) of N points, (N, D), write sine and cosine of each k, coordinate by
    coordinate [Mildenhall et al. 2020, equation 4]. With `include_input` the coordinates come
    first; with `constant` a 1 comes last. The `width` columns of `features` begin at `column`; the
    rest of them is 0.
    """
    count = features.shape[0]
    launch_each(
        _positional(features.dtype),
        count,
        16 * width * count,
        [points, total, frequencies, include_input, constant, column, column + width],
        [features],
    )


def gather(
    table: wp.array, rows: wp.array, total: wp.array, column: int, features: wp.array
) -> None:
    """``features[:, column:column + C] = table[rows]`` for the first `total` (1,) of `rows` (M,).

    `table` (R, C) has the dtype of `features`.
    """
    count = features.shape[0]
    launch_each(
        _gather(features.dtype),
        count,
        table.shape[1] * count,
        [table, rows, total, column],
        [features],
    )
