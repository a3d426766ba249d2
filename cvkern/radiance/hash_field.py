"""A hash encoding and two small perceptrons: instant neural graphics primitives."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cvkern._runtime import Runtime
from cvkern.radiance.fields import Frame, Learning
from cvkern.radiance.sampled import CELLS, SampledField, Samples, taken

FEATURES, WIDTH, HARMONICS = 16, 64, 16  # of the density's perceptron, of a layer, of the view
BETAS, EPSILON = (0.9, 0.99), 1e-15
HALF_SCALE = 128.0  # lifts gradients above what float16 takes for 0


@dataclass(frozen=True)
class HashField:
    """Settings of a field of hashed features.

    A sample's features come from tables for grids of growing fineness; a small perceptron makes a
    density and 16 numbers of them, and a second one a colour of these and the direction of view.

    References
    ----------
    .. [1] T. Mueller, A. Evans, C. Schied and A. Keller, "Instant neural graphics primitives with
       a multiresolution hash encoding", ACM Transactions on Graphics 41(4), 2022.
    """

    levels: int = 16
    """Grids; twice as many must be a multiple of 16."""
    table_bits: int = 19
    """Base-2 logarithm of the entries of a grid's table."""
    coarsest: int = 16
    """Cells of the coarsest grid along a side."""
    finest: int = 2048
    """Cells of the finest grid along a side."""
    samples: int = 2**18
    """Of a batch."""
    rays: int = 2**14
    """Of a batch, at most."""
    cells: int = CELLS
    """Of the occupancy grid, along a side."""
    learning_rate: float = 1e-2
    final_rate: float = 0.03
    """Share of the learning rate at the end."""
    weight_decay: float = 1e-6
    """Of the perceptrons."""
    table_decay: float = 1e-6
    """Of the tables: entries that no photograph needs go back to 0; held-out views gain by it."""

    def build(self, rt: Runtime, frame: Frame, seed: int) -> HashNetwork:
        """Return the field itself, with random parameters."""
        return HashNetwork(rt, frame, seed, self)


class HashNetwork(SampledField):
    """A field with the settings of a :class:`HashField`."""

    def __init__(self, rt: Runtime, frame: Frame, seed: int, settings: HashField):
        self.settings, self.half = settings, rt.matrix_dtype
        super().__init__(rt, frame, settings.samples, settings.rays, settings.cells, seed)
        self.gradient_scale = 1.0 if self.half == np.float32 else HALF_SCALE
        levels, rng = settings.levels, np.random.default_rng(seed)
        growth = (settings.finest / settings.coarsest) ** (1 / max(levels - 1, 1))
        resolutions = np.round(settings.coarsest * growth ** np.arange(levels)).astype(np.int32)
        corners = (resolutions.astype(np.int64) + 1) ** 3
        sizes = np.minimum(-(-corners // 8) * 8, 2**settings.table_bits)
        offsets = np.concatenate(([0], np.cumsum(sizes))).astype(np.int32)
        self.grids = rt.constant(resolutions), rt.constant(offsets)
        self.table = Parameters(rt, rng.uniform(-1e-4, 1e-4, (int(offsets[-1]), 2)), self.half)
        inner = FEATURES + HARMONICS
        shapes = [
            (2 * levels, WIDTH),
            (WIDTH, FEATURES),
            (inner, WIDTH),
            (WIDTH, WIDTH),
            (WIDTH, 16),
        ]
        # Xavier's limits keep the size of what passes through a layer.
        layers = [rng.uniform(-1, 1, s) * math.sqrt(6 / (s[0] + s[1])) for s in shapes]
        self.layers = Parameters(rt, np.concatenate([w.ravel() for w in layers]), self.half)
        ends = np.cumsum([w.size for w in layers])
        parts = [(slice(e - w.size, e), w.shape) for e, w in zip(ends, layers, strict=True)]
        self.weights = [self.layers.copy[at].reshape(shape) for at, shape in parts]
        self.d_weights = [self.layers.gradients[at].reshape(shape) for at, shape in parts]
        self.gradients = self.inner(settings.samples)
        self._rate, self._factor, self._parts_of_norm = (rt.zeros((n,)) for n in (3, 1, 1024))

    def inner(self, room: int) -> dict[str, Any]:
        """See :meth:`SampledField.inner`: what the layers take and give."""
        widths = {"features": 2 * self.settings.levels, "first": WIDTH,
                  "hidden": FEATURES + HARMONICS, "second": WIDTH, "third": WIDTH,
                  "raw": 16}  # fmt: skip
        return {name: self.rt.zeros((room, width), self.half) for name, width in widths.items()}

    def evaluate_density(self, total: Any) -> None:
        """See :meth:`SampledField.evaluate_density`."""
        rt, s, v = self.rt, self.samples, self.samples.inner
        rt.radiance_hash.encode(s.positions, total, *self.grids, self.table.copy, v["features"])
        rt.radiance_dense.forward(v["features"], self.weights[0], total, True, 0, v["first"])
        rt.radiance_dense.forward(v["first"], self.weights[1], total, False, 0, v["hidden"])
        rt.radiance_heads.forward(v["hidden"], v["raw"], total, s.sigma, s.rgb)

    def evaluate(self, directions: Any, samples: Samples) -> None:
        """See :meth:`SampledField.evaluate`."""
        rt, s, v = self.rt, samples, samples.inner
        rt.radiance_hash.encode(s.positions, s.total, *self.grids, self.table.copy, v["features"])
        layers = (
            ("features", 0, True, "first"), ("first", 1, False, "hidden"),
            ("hidden", 2, True, "second"), ("second", 3, True, "third"), ("third", 4, False, "raw"),
        )  # fmt: skip
        rt.radiance_encode.spherical(directions, s.rays, s.total, FEATURES, v["hidden"])
        for source, layer, relu, target in layers:
            rt.radiance_dense.forward(v[source], self.weights[layer], s.total, relu, 0, v[target])
        rt.radiance_heads.forward(v["hidden"], v["raw"], s.total, s.sigma, s.rgb)

    def evaluate_backward(self) -> None:
        """See :meth:`SampledField.evaluate_backward`."""
        rt, g, s, total = self.rt, self.gradients, self.samples, self.samples.total
        rt.radiance_heads.color_backward(self.d_rgb, s.rgb, total, g["raw"])
        self._layer_backward("third", 4, True, "raw")
        self._layer_backward("second", 3, True, "third")
        self._layer_backward("hidden", 2, False, "second")
        rt.radiance_heads.density_backward(self.d_sigma, s.sigma, total, g["hidden"])
        self._layer_backward("first", 1, True, "hidden")
        self._layer_backward("features", 0, False, "first")
        rt.radiance_hash.backward(
            s.positions, total, *self.grids, g["features"], self.table.gradients
        )

    def _layer_backward(self, source: str, layer: int, gated: bool, target: str) -> None:
        """Take the gradients of a layer's output to its input, and to its weights."""
        dense, total = self.rt.radiance_dense, self.samples.total
        x, dy = self.samples.inner[source], self.gradients[target]
        dense.backward_input(dy, self.weights[layer], x, total, gated, 0, self.gradients[source])
        dense.backward_weight(dy, x, total, 0, self.d_weights[layer])

    def learn(self, learning: Learning) -> None:
        """See :meth:`Field.learn`."""
        adam, s = self.rt.radiance_adam, self.settings
        adam.learning_rate(
            learning.step, learning.progress, s.learning_rate, 100, s.final_rate, *BETAS, self._rate
        )
        adam.clip(learning.scale / self.gradient_scale, 1e30, self._parts_of_norm, self._factor)
        for parameters, decay, sparse in (
            (self.table, s.table_decay, s.table_decay == 0.0),
            (self.layers, s.weight_decay, False),
        ):
            adam.adam(self._rate, self._factor, *BETAS, EPSILON, decay, sparse, *parameters.flat())

    def state(self) -> dict[str, np.ndarray]:
        """See :meth:`Field.state`."""
        return (
            super().state()
            | self.table.state("table.", self.rt)
            | self.layers.state("layers.", self.rt)
        )

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """See :meth:`Field.restore`."""
        super().restore(state)
        self.table.restore("table.", state, self.rt)
        self.layers.restore("layers.", state, self.rt)


class Parameters:
    """Parameters with what Adam keeps for them, and a copy in the precision they are used in."""

    def __init__(self, rt: Runtime, values: np.ndarray, dtype: Any):
        shape = values.shape
        self.values, self.gradients, self.mean, self.square = (rt.zeros(shape) for _ in range(4))
        self.copy = self.values if dtype == np.float32 else rt.zeros(shape, dtype)
        self._write(values, rt)

    def _write(self, values: np.ndarray, rt: Runtime) -> None:
        rt.write(self.values, values.astype(np.float32))
        if self.copy is not self.values:
            rt.write(self.copy, values.astype(np.float16))

    def flat(self) -> list[Any]:
        """Return gradients, means, squares, values and copy, as Adam takes them."""
        arrays = (self.gradients, self.mean, self.square, self.values, self.copy)
        return [a.reshape((-1,)) if len(a.shape) > 1 else a for a in arrays]

    def state(self, prefix: str, rt: Runtime) -> dict[str, np.ndarray]:
        """Return what has to be saved."""
        arrays = {"values": self.values, "mean": self.mean, "square": self.square}
        return {prefix + name: rt.to_numpy(a).copy() for name, a in arrays.items()}

    def restore(self, prefix: str, state: dict[str, np.ndarray], rt: Runtime) -> None:
        """Take up what was saved."""
        self._write(taken(state, prefix + "values", self.values.shape), rt)
        rt.write(self.mean, taken(state, prefix + "mean", self.mean.shape))
        rt.write(self.square, taken(state, prefix + "square", self.square.shape))
