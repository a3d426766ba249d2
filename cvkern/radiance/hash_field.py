"""A hash encoding and two small perceptrons: instant neural graphics primitives."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cvkern._runtime import Runtime
from cvkern._validate import check_integer, check_number, check_positive
from cvkern.radiance.fields import Frame, Learning, Rays
from cvkern.radiance.parameters import Clip, Parameters
from cvkern.radiance.sampled import CELLS, STEPS, SampledField

FEATURES, WIDTH, HARMONICS = 16, 64, 16  # of the density's perceptron, of a layer, of the view
BETAS, EPSILON = (0.9, 0.99), 1e-15
CELLS_OF_PIXEL = 2.0  # of the finest grid: with more, held-out views of small photographs lose
LIFT = 128.0  # of gradients above what float16, or a fixed-point number, takes for 0


@dataclass(frozen=True)
class HashField:
    """Settings of a field of hashed features.

    A sample's features come from tables for grids of growing fineness; a small perceptron makes a
    density and 16 numbers of them, and a second one a colour of these and the direction of view.

    Raises
    ------
    TypeError
        If a number is of another kind.
    ValueError
        If a number is out of its range, `levels` or `cells` are no multiples of 8, or `finest` is
        below `coarsest`.

    References
    ----------
    .. [1] T. Mueller, A. Evans, C. Schied and A. Keller, "Instant neural graphics primitives with
       a multiresolution hash encoding", ACM Transactions on Graphics 41(4), 2022.
    """

    levels: int = 8
    """Grids, a multiple of 8."""
    table_bits: int = 19
    """Base-2 logarithm of the entries of a grid's table."""
    coarsest: int = 16
    """Cells of the coarsest grid along a side."""
    finest: int | None = None
    """Cells of the finest grid along a side; by default two for each pixel of the photographs."""
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
    table_decay: float = 1e-7
    """Of the tables: entries that no photograph needs go back to 0; held-out views gain by it."""
    gradient_clip: float | None = None
    """Norm, > 0, to which all gradients together are shrunk if theirs is larger.

    They are those of the sum of the losses of a batch's rays over 4096.
    """

    def __post_init__(self) -> None:
        for name, least, most in (
            ("levels", 8, 32), ("table_bits", 3, 24), ("coarsest", 1, 2**14), ("rays", 1, 2**24),
            ("samples", STEPS, 2**24), ("cells", 8, 512),
        ):  # fmt: skip
            check_integer(getattr(self, name), name, least, most)
        if self.finest is not None:
            check_integer(self.finest, "finest", self.coarsest, 2**20)
        for name in ("levels", "cells"):
            if getattr(self, name) % 8:
                raise ValueError(f"{name} must be a multiple of 8, got {getattr(self, name)}")
        for name in ("learning_rate", "final_rate"):
            check_positive(getattr(self, name), name)
        for name in ("weight_decay", "table_decay"):
            check_number(getattr(self, name), name, low=0.0)
        if self.gradient_clip is not None:
            check_positive(self.gradient_clip, "gradient_clip")

    def build(self, rt: Runtime, frame: Frame, seed: int) -> HashNetwork:
        """Return the field itself, with random parameters."""
        return HashNetwork(rt, frame, seed, self)


class HashNetwork(SampledField):
    """A field with the settings of a :class:`HashField`."""

    def __init__(self, rt: Runtime, frame: Frame, seed: int, settings: HashField):
        super().__init__(rt, frame, settings.samples, settings.rays, settings.cells, seed)
        self.settings = settings
        self.half = rt.matrix_dtype
        self.gradient_scale = 1.0 if self.half == np.float32 else LIFT
        levels, rng = settings.levels, np.random.default_rng(seed)
        finest = settings.finest
        if finest is None:
            # All of space is contracted into twice the cube.
            side = 4 if frame.bounds.unbounded else 2
            finest = max(2 * settings.coarsest, round(CELLS_OF_PIXEL * side / frame.pixel))
        growth = (finest / settings.coarsest) ** (1 / max(levels - 1, 1))
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
        widths = {"features": 2 * levels, "first": WIDTH, "hidden": inner, "second": WIDTH,
                  "third": WIDTH, "raw": 16}  # fmt: skip
        self.values, self.gradients = (
            {name: rt.zeros((settings.samples, width), self.half) for name, width in widths.items()}
            for _ in range(2)
        )
        self._rate, self._clip = rt.zeros((3,)), Clip(rt, settings.gradient_clip)

    def evaluate_density(self, total: Any) -> None:
        """See :meth:`SampledField.evaluate_density`."""
        rt, v = self.rt, self.values
        positions = self.samples.positions
        rt.radiance_hash.encode(positions, total, *self.grids, self.table.copy, v["features"])
        rt.radiance_dense.forward(v["features"], self.weights[0], total, True, 0, v["first"])
        rt.radiance_dense.forward(v["first"], self.weights[1], total, False, 0, v["hidden"])
        rt.radiance_heads.forward(v["hidden"], v["raw"], total, self.sigma, self.rgb)

    def evaluate(self, rays: Rays) -> None:
        """See :meth:`SampledField.evaluate`."""
        rt, v, s = self.rt, self.values, self.samples
        rt.radiance_hash.encode(s.positions, s.total, *self.grids, self.table.copy, v["features"])
        layers = (
            ("features", 0, True, "first"), ("first", 1, False, "hidden"),
            ("hidden", 2, True, "second"), ("second", 3, True, "third"), ("third", 4, False, "raw"),
        )  # fmt: skip
        rt.radiance_encode.spherical(rays.directions, s.rays, s.total, FEATURES, v["hidden"])
        for source, layer, relu, target in layers:
            rt.radiance_dense.forward(v[source], self.weights[layer], s.total, relu, 0, v[target])
        rt.radiance_heads.forward(v["hidden"], v["raw"], s.total, self.sigma, self.rgb)

    def evaluate_backward(self) -> None:
        """See :meth:`SampledField.evaluate_backward`."""
        rt, g, total = self.rt, self.gradients, self.samples.total
        rt.radiance_heads.color_backward(self.d_rgb, self.rgb, total, g["raw"])
        self._layer_backward("third", 4, True, "raw")
        self._layer_backward("second", 3, True, "third")
        self._layer_backward("hidden", 2, False, "second")
        rt.radiance_heads.density_backward(self.d_sigma, self.sigma, total, g["hidden"])
        self._layer_backward("first", 1, True, "hidden")
        self._layer_backward("features", 0, False, "first")
        rt.radiance_hash.backward(
            self.samples.positions, total, *self.grids, g["features"], self.table.sums
        )
        self.table.collect(rt)

    def _layer_backward(self, source: str, layer: int, gated: bool, target: str) -> None:
        """Take the gradients of a layer's output to its input, and to its weights."""
        dense, total = self.rt.radiance_dense, self.samples.total
        x, dy = self.values[source], self.gradients[target]
        dense.backward_input(dy, self.weights[layer], x, total, gated, 0, self.gradients[source])
        dense.backward_weight(dy, x, total, 0, self.d_weights[layer])

    def make_deterministic(self) -> None:
        """See :meth:`Field.make_deterministic`: tables are added to by atomics on a GPU."""
        if self.rt.device != "cpu":
            self.gradient_scale = LIFT
            self.table.make_deterministic(self.rt)

    def learn(self, learning: Learning) -> None:
        """See :meth:`Field.learn`."""
        adam, s = self.rt.radiance_adam, self.settings
        adam.learning_rate(
            learning.step, learning.progress, s.learning_rate, 100, s.final_rate, *BETAS, self._rate
        )
        gradients = self.table.gradients, self.layers.gradients
        self._clip.update(learning.scale / self.gradient_scale, *gradients)
        for parameters, decay, sparse in (
            (self.table, s.table_decay, s.table_decay == 0.0),
            (self.layers, s.weight_decay, False),
        ):
            given = self._rate, self._clip.factor, *BETAS, EPSILON, decay, sparse
            adam.adam(*given, *parameters.flat())

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
