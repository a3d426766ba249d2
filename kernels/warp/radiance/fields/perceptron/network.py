"""The two perceptrons of a hash field, from features to density and colour and back, in Warp.

The layers (see `network_layers`) lie one behind another in one array of weights, each (K, N). The
first of the first perceptron and two of the second end with a rectifier. On CUDA one kernel goes
through all of them, on the CPU there is one for each, and one for the views' harmonics.
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
    """Find density (M,) and colour (M, 3) from features (M, K) and directions of view (R, 3).

    `rays` (M,) are those of the samples. As everywhere below, of the first `total` (1,) of them,
    for K = 16, 32, 48 or 64, with `weights` (W,) of all layers and `memory` of the shape that
    `network_room` tells.
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
    """Find density (M,) alone, as :func:`forward` does."""
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
    unused = memory[:3].reshape((memory.shape[1], 3))  # a colour, over what the first layer gave
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
    """Take the gradients of what :func:`forward` last gave to `d_features` (M, K) and `d_weights`.

    What is between is in `memory` on the CPU, which nothing else must have used, and found again
    on CUDA. `d_weights`, float32, is added to, in an order that does not change from run to run.
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
        if k == 1:  # the first perceptron: what the second one wants of it is there
            heads.density_backward(d_sigma, sigma, total, gradients[2])
        x, dx, dy = values[k], gradients[k], gradients[k + 1]
        gated = k > 0 and NETWORK_RECTIFIED[k - 1]
        dense.backward_input(dy, layers[k], x, total, gated, 0, dx)
        dense.backward_weight(dy, x, total, 0, d_layers[k])


def _pass(features: wp.array, total: wp.array, weights: wp.array, values: list[wp.array]) -> None:
    """Go through as many layers as there are `values`."""
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
    """Cut the memory, from a row on, into what is kept of each layer, a row for each sample."""
    found = []
    for width in NETWORK_VALUES:
        rows = memory[begin : begin + width]
        found.append(rows.reshape((memory.shape[1], width))[: features.shape[0]])
        begin += width
    return found
