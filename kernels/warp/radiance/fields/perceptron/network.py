"""The two perceptrons of a hash field, from features to density and colour and back, in Warp.

The layers (see `network_layers`) follow one another in one array of weights, each (K, N). The first
layer of the first perceptron and two layers of the second end with a rectifier. On CUDA one kernel
computes all layers. On the CPU there is one kernel for each layer, and one for the harmonics of the
viewing directions.
"""

import math

import warp as wp

from cvkern.kernels.codes.radiance import (
    NETWORK_PARTS,
    NETWORK_RECTIFIED,
    NETWORK_VALUES,
    network_layers,
)
from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp.radiance import _sums_cuda as parts_cuda
from cvkern.kernels.warp.radiance import encodings as encode

from . import _network_cuda as cuda
from . import heads
from . import layers as dense


def forward(
    features: wp.array,
    directions: wp.array,
    rays: wp.array,
    total: wp.array,
    weights: wp.array,
    memory: wp.array,
    sigma: wp.array,
    rgb: wp.array,
) -> None:
    """Compute density (M,) and colour (M, 3) from features (M, K) and viewing directions (R, 3).

    `rays` (M,) are the rays of the samples. All functions of this module process the first `total`
    (1,) samples, for K = 16, 32, 48 or 64, with `weights` (W,) of all layers and `memory` of the
    shape of `network_room`.
    """
    if sigma.device.is_cuda:
        kernel = cuda.forward(features.shape[1])
        given = [features, directions, rays, total, weights]
        launch(kernel, NETWORK_PARTS * cuda.FORWARD, given, [sigma, rgb], cuda.FORWARD)
        return
    values = _views(memory, 0, features)
    encode.spherical(directions, rays, total, 16, values[1])
    _pass(features, total, weights, values)
    heads.forward(values[1], values[-1], total, sigma, rgb)


def density(
    features: wp.array, total: wp.array, weights: wp.array, memory: wp.array, sigma: wp.array
) -> None:
    """Compute only the density (M,), as :func:`forward` does."""
    if sigma.device.is_cuda:
        kernel = cuda.density(features.shape[1])
        launch(
            kernel,
            NETWORK_PARTS * cuda.FORWARD,
            [features, total, weights],
            [sigma],
            cuda.FORWARD,
        )
        return
    values = _views(memory, 0, features)[:2]
    _pass(features, total, weights, values)
    unused = memory[:3].reshape(
        (memory.shape[1], 3)
    )  # a colour that nobody reads, in the memory of the first layer
    heads.forward(values[1], values[1], total, sigma, unused)


def backward(
    d_sigma: wp.array,
    d_rgb: wp.array,
    features: wp.array,
    directions: wp.array,
    rays: wp.array,
    total: wp.array,
    weights: wp.array,
    sigma: wp.array,
    rgb: wp.array,
    memory: wp.array,
    d_features: wp.array,
    d_weights: wp.array,
) -> None:
    """Compute `d_features` (M, K) and `d_weights` from gradients by the last :func:`forward`.

    On the CPU, `memory` must still hold the values between the layers; on CUDA they are computed
    again. `d_weights`, float32, is added to, in an order that is the same in every run.
    """
    if d_features.device.is_cuda:
        given = [d_sigma, d_rgb, features, directions, rays, total, weights, sigma, rgb]
        kernel = cuda.backward(features.shape[1])
        threads = memory.shape[0] * cuda.BACKWARD
        launch(kernel, threads, given, [d_features, memory], cuda.BACKWARD)
        count = parts_cuda.threads(weights.shape[0])
        launch(parts_cuda.gather, count, [memory], [d_weights])
        return
    values = [features, *_views(memory, 0, features)]
    gradients = [d_features, *_views(memory, sum(NETWORK_VALUES), features)]
    layers, d_layers = _layers(weights, features), _layers(d_weights, features)
    heads.color_backward(d_rgb, rgb, total, gradients[5])
    for k in reversed(range(5)):
        if k == 1:  # the first perceptron gets the gradients from the second one
            heads.density_backward(d_sigma, sigma, total, gradients[2])
        x, dx, dy = values[k], gradients[k], gradients[k + 1]
        gated = k > 0 and NETWORK_RECTIFIED[k - 1]
        dense.backward_input(dy, layers[k], x, total, gated, 0, dx)
        dense.backward_weight(dy, x, total, 0, d_layers[k])


def _pass(features: wp.array, total: wp.array, weights: wp.array, values: list[wp.array]) -> None:
    """Compute as many layers as there are `values`."""
    layers = _layers(weights, features)
    for x, w, relu, y in zip([features, *values], layers, NETWORK_RECTIFIED, values, strict=False):
        dense.forward(x, w, total, relu, 0, y)


def _layers(weights: wp.array, features: wp.array) -> list[wp.array]:
    """Cut weights, or their gradients, into layers."""
    found, begin = [], 0
    for shape in network_layers(features.shape[1]):
        end = begin + math.prod(shape)
        found.append(weights[begin:end].reshape(shape))
        begin = end
    return found


def _views(memory: wp.array, begin: int, features: wp.array) -> list[wp.array]:
    """Cut the memory, beginning at a row, into the values of each layer, one row per sample."""
    found = []
    for width in NETWORK_VALUES:
        rows = memory[begin : begin + width]
        found.append(rows.reshape((memory.shape[1], width))[: features.shape[0]])
        begin += width
    return found
