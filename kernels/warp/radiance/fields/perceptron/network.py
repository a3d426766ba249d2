"""The two perceptrons of a hash field, from features to density and colour and back, in Warp.

The layers (see `network_layers`) follow one another in one array of weights, each (K, N). The first
layer of the first perceptron and two layers of the second end with a rectifier. On CUDA one kernel
computes all layers. On the CPU there is one kernel for each layer, and one for the harmonics of the
viewing directions. Lights of photographs, if there are any, are inputs of the second perceptron.
"""

import math
from typing import Any

import warp as wp

from cvkern.kernels.codes.radiance import (
    LIGHT_COLUMN,
    NETWORK_PARTS,
    NETWORK_RECTIFIED,
    NetworkInputs,
    network_layers,
    network_values,
)
from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp.radiance import _sums_cuda as parts_cuda
from cvkern.kernels.warp.radiance import encodings as encode
from cvkern.kernels.warp.radiance._structs import Sides
from cvkern.kernels.warp.radiance.wild import embeddings as light

from . import _network_cuda as cuda
from . import heads
from . import layers as dense


def forward(given: NetworkInputs, memory: wp.array, sigma: wp.array, rgb: wp.array) -> None:
    """Compute density (M,) and colour (M, 3) of the samples.

    All functions of this module process the first `total` (1,) samples, with `memory` of the shape
    of `network_room`.
    """
    lit = given.table is not None
    if sigma.device.is_cuda:
        kernel = cuda.forward(given.features.shape[1], lit)
        arrays = [given.features, _sides(given), given.total, given.weights]
        launch(kernel, NETWORK_PARTS * cuda.FORWARD, arrays, [sigma, rgb], cuda.FORWARD)
        return
    features, directions, rays, total, weights, table, views = given
    values = _views(memory, 0, features, lit)
    encode.spherical(directions, rays, total, 16, values[1])
    if lit:
        light.gather(table, views, rays, total, LIGHT_COLUMN, values[1])
    _pass(features, total, weights, values, lit)
    heads.forward(values[1], values[-1], total, sigma, rgb)


def density(
    features: wp.array, total: wp.array, weights: wp.array, memory: wp.array, sigma: wp.array
) -> None:
    """Compute only the density (M,) from features (M, K), as :func:`forward` does."""
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
    values = _views(memory, 0, features, False)[:2]
    _pass(features, total, weights, values, False)
    unused = memory[:3].reshape(
        (memory.shape[1], 3)
    )  # a colour that nobody reads, in the memory of the first layer
    heads.forward(values[1], values[1], total, sigma, unused)


def backward(
    d_sigma: wp.array,
    d_rgb: wp.array,
    given: NetworkInputs,
    sigma: wp.array,
    rgb: wp.array,
    memory: wp.array,
    d_features: wp.array,
    d_lights: wp.array | None,
    d_weights: wp.array,
) -> None:
    """Compute `d_features` (M, K) and `d_weights` from gradients by the last :func:`forward`.

    On the CPU, `memory` must still hold the values between the layers; on CUDA they are computed
    again. `d_weights`, float32, is added to, in an order that is the same in every run. With
    lights, compute the gradients by the light of each sample, `d_lights` (M, 16) float32.
    """
    lit = given.table is not None
    features, total, weights = given.features, given.total, given.weights
    if d_features.device.is_cuda:
        arrays = [d_sigma, d_rgb, features, _sides(given), total, weights, sigma, rgb]
        kernel = cuda.backward(features.shape[1], lit)
        threads = memory.shape[0] * cuda.BACKWARD
        results = [d_features, memory if d_lights is None else d_lights, memory]
        launch(kernel, threads, arrays, results, cuda.BACKWARD)
        count = parts_cuda.threads(weights.shape[0])
        launch(parts_cuda.gather, count, [memory], [d_weights])
        return
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


def _sides(given: NetworkInputs) -> Any:
    """Return directions and lights as a Warp structure; without lights their arrays are empty."""
    found = Sides()
    found.directions, found.rays = given.directions, given.rays
    if given.table is not None:
        found.table, found.views = given.table, given.views
    return found


def _pass(
    features: wp.array, total: wp.array, weights: wp.array, values: list[wp.array], lit: bool
) -> None:
    """Compute as many layers as there are `values`."""
    layers = _layers(weights, features, lit)
    for x, w, relu, y in zip([features, *values], layers, NETWORK_RECTIFIED, values, strict=False):
        dense.forward(x, w, total, relu, 0, y)


def _layers(weights: wp.array, features: wp.array, lit: bool) -> list[wp.array]:
    """Cut weights, or their gradients, into layers."""
    found, begin = [], 0
    for shape in network_layers(features.shape[1], lit):
        end = begin + math.prod(shape)
        found.append(weights[begin:end].reshape(shape))
        begin = end
    return found


def _views(memory: wp.array, begin: int, features: wp.array, lit: bool) -> list[wp.array]:
    """Cut the memory, beginning at a row, into the values of each layer, one row per sample."""
    found = []
    for width in network_values(lit):
        rows = memory[begin : begin + width]
        found.append(rows.reshape((memory.shape[1], width))[: features.shape[0]])
        begin += width
    return found
