"""Density and colour from the outputs of a perceptron, forward and backward, in Warp.

With s = exp(h), ds/dh = s; with c = 1 / (1 + exp(-r)), dc/dr = c (1 - c). The density is clamped at
e^11, but the gradient by h does not become 0 there, so that the density can decrease again. One
thread per sample.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.radiance import MOST_LOG_DENSITY, MOST_LOG_DENSITY_GRADIENT
from cvkern.kernels.warp._launch import launch_each

OPTIONS = {"enable_backward": False}  # options of kernels that are made for a dtype


@cache
def _forward(scalar: Any) -> wp.Kernel:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def forward(
        stride: int,
        first: int,
        last: int,
        hidden: wp.array2d[scalar],  # (M, >= 1)
        raw: wp.array2d[scalar],  # (M, >= 3)
        total: wp.array[int],  # (1,)
        # outputs
        sigma: wp.array[float],  # (M,)
        rgb: wp.array2d[float],  # (M, 3)
    ):
        for i in range(first + wp.tid(), wp.min(last, total[0]), stride):
            sigma[i] = wp.exp(wp.min(float(hidden[i, 0]), MOST_LOG_DENSITY))
            for k in range(3):
                rgb[i, k] = 1.0 / (1.0 + wp.exp(-float(raw[i, k])))

    return forward


@cache
def _color_backward(scalar: Any) -> wp.Kernel:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def color_backward(
        stride: int,
        first: int,
        last: int,
        d_rgb: wp.array2d[float],  # (M, 3)
        rgb: wp.array2d[float],  # (M, 3)
        total: wp.array[int],  # (1,)
        # outputs
        d_raw: wp.array2d[scalar],  # (M, >= 3): 0 behind the third column
    ):
        for i in range(first + wp.tid(), wp.min(last, total[0]), stride):
            for k in range(3):
                d_raw[i, k] = scalar(d_rgb[i, k] * rgb[i, k] * (1.0 - rgb[i, k]))
            for k in range(3, d_raw.shape[1]):
                d_raw[i, k] = scalar(0.0)

    return color_backward


@cache
def _density_backward(scalar: Any) -> wp.Kernel:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def density_backward(
        stride: int,
        first: int,
        last: int,
        d_sigma: wp.array[float],  # (M,)
        sigma: wp.array[float],  # (M,)
        total: wp.array[int],  # (1,)
        # outputs
        d_hidden: wp.array2d[scalar],  # (M, >= 1): column 0 is added to
    ):
        for i in range(first + wp.tid(), wp.min(last, total[0]), stride):
            d = d_sigma[i] * sigma[i]
            if wp.abs(d) > MOST_LOG_DENSITY_GRADIENT:  # keeps NaN
                d = wp.sign(d) * MOST_LOG_DENSITY_GRADIENT
            d_hidden[i, 0] = scalar(float(d_hidden[i, 0]) + d)

    return density_backward


def forward(
    hidden: wp.array, raw: wp.array, total: wp.array, sigma: wp.array, rgb: wp.array
) -> None:
    """``sigma = exp(hidden[:, 0])`` (M,), ``rgb = 1 / (1 + exp(-raw[:, :3]))`` (M, 3).

    All functions of this module process the first `total` (1,) rows.
    """
    count = sigma.shape[0]
    launch_each(_forward(hidden.dtype), count, 16 * count, [hidden, raw, total], [sigma, rgb])


def color_backward(d_rgb: wp.array, rgb: wp.array, total: wp.array, d_raw: wp.array) -> None:
    """Compute `d_raw` (M, >= 3) from the gradient by `rgb` (M, 3); it is 0 after column 2."""
    count = rgb.shape[0]
    launch_each(_color_backward(d_raw.dtype), count, 16 * count, [d_rgb, rgb, total], [d_raw])


def density_backward(
    d_sigma: wp.array, sigma: wp.array, total: wp.array, d_hidden: wp.array
) -> None:
    """Add the gradient by the exponent, clipped to +-30000, to column 0 of (M, >= 1)."""
    count = sigma.shape[0]
    launch_each(
        _density_backward(d_hidden.dtype), count, 8 * count, [d_sigma, sigma, total], [d_hidden]
    )
