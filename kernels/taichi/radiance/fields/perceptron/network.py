"""The two perceptrons of a hash field, from features to density and colour and back, in Taichi.

The layers (see `network_layers`) follow one another in one array of weights, each (K, N). The first
layer of the first perceptron and two layers of the second end with a rectifier. One thread per
output element of a layer.
"""

import math

import numpy as np

from cvkern.kernels.codes.radiance import (
    LIGHT_COLUMN,
    NETWORK_RECTIFIED,
    NetworkInputs,
    network_layers,
    network_values,
)
from cvkern.kernels.taichi.radiance import encodings as encode
from cvkern.kernels.taichi.radiance.wild import embeddings as light

from . import heads
from . import layers as dense


def forward(given: NetworkInputs, memory: np.ndarray, sigma: np.ndarray, rgb: np.ndarray) -> None:
    """Compute density (M,) and colour (M, 3) of the samples.

    All functions of this module process the first `total` (1,) samples, with `memory` of the shape
    of `network_room`.
    """
    features, directions, rays, total, weights, table, views = given
    lit = table is not None
    values = _views(memory, 0, features, lit)
    encode.spherical(directions, rays, total, 16, values[1])
    if lit:
        light.gather(table, views, rays, total, LIGHT_COLUMN, values[1])
    _pass(features, total, weights, values, lit)
    heads.forward(values[1], values[-1], total, sigma, rgb)


def density(
    features: np.ndarray,
    total: np.ndarray,
    weights: np.ndarray,
    memory: np.ndarray,
    sigma: np.ndarray,
) -> None:
    """Compute only the density (M,) from features (M, K), as :func:`forward` does."""
    values = _views(memory, 0, features, False)[:2]
    _pass(features, total, weights, values, False)
    unused = memory[:3].reshape(
        (memory.shape[1], 3)
    )  # a colour that nobody reads, in the memory of the first layer
    heads.forward(values[1], values[1], total, sigma, unused)


def backward(
    d_sigma: np.ndarray,
    d_rgb: np.ndarray,
    given: NetworkInputs,
    sigma: np.ndarray,
    rgb: np.ndarray,
    memory: np.ndarray,
    d_features: np.ndarray,
    d_lights: np.ndarray | None,
    d_weights: np.ndarray,
) -> None:
    """Compute `d_features` (M, K) and `d_weights` from gradients by the last :func:`forward`.

    `memory` must still hold the values between the layers. `d_weights` is added to. With lights,
    compute the gradients by the light of each sample, `d_lights` (M, 16).
    """
    lit = given.table is not None
    features, total, weights = given.features, given.total, given.weights
    values = [features, *_views(memory, 0, features, lit)]
    begin = sum(network_values(lit))
    gradients = [d_features, *_views(memory, begin, features, lit)]
    layers, d_layers = _layers(weights, features, lit), _layers(d_weights, features, lit)
    heads.color_backward(d_rgb, rgb, total, gradients[5])
    for k in reversed(range(5)):
        if k == 1:  # the first perceptron gets the gradients from the second one
            heads.density_backward(d_sigma, sigma, total, gradients[2])
        x, dx, dy = values[k], gradients[k], gradients[k + 1]
        gated = k > 0 and NETWORK_RECTIFIED[k - 1]
        dense.backward_input(dy, layers[k], x, total, gated, 0, dx)
        dense.backward_weight(dy, x, total, 0, d_layers[k])
    if d_lights is not None:
        light.copy(gradients[2], total, LIGHT_COLUMN, d_lights)


def _pass(
    features: np.ndarray,
    total: np.ndarray,
    weights: np.ndarray,
    values: list[np.ndarray],
    lit: bool,
) -> None:
    """Compute as many layers as there are `values`."""
    layers = _layers(weights, features, lit)
    for x, w, relu, y in zip([features, *values], layers, NETWORK_RECTIFIED, values, strict=False):
        dense.forward(x, w, total, relu, 0, y)


def _layers(weights: np.ndarray, features: np.ndarray, lit: bool) -> list[np.ndarray]:
    """Cut weights, or their gradients, into layers."""
    found, begin = [], 0
    for shape in network_layers(features.shape[1], lit):
        end = begin + math.prod(shape)
        found.append(weights[begin:end].reshape(shape))
        begin = end
    return found


def _views(memory: np.ndarray, begin: int, features: np.ndarray, lit: bool) -> list[np.ndarray]:
    """Cut the memory, beginning at a row, into the values of each layer, one row per sample."""
    found = []
    for width in network_values(lit):
        rows = memory[begin : begin + width]
        found.append(rows.reshape((memory.shape[1], width))[: features.shape[0]])
        begin += width
    return found
