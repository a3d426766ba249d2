"""A hash encoding and two small perceptrons: instant neural graphics primitives."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cvkern._runtime import Runtime
from cvkern._validate import check_integer, check_number, check_positive
from cvkern.kernels.codes import network_layers, network_room
from cvkern.radiance.fields import Frame, Learning, Rays
from cvkern.radiance.sampled import CELLS, STEPS, SampledField, taken

BETAS, EPSILON = (0.9, 0.99), 1e-15
CELLS_OF_PIXEL = 2.0  # of the finest grid: with more, held-out views of small photographs lose
HALF_SCALE = 128.0  # lifts gradients above what float16 takes for 0


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

    def build(self, rt: Runtime, frame: Frame, seed: int) -> HashNetwork:
        """Return the field itself, with random parameters."""
        return HashNetwork(rt, frame, seed, self)


class HashNetwork(SampledField):
    """A field with the settings of a :class:`HashField`."""

    def __init__(self, rt: Runtime, frame: Frame, seed: int, settings: HashField):
        super().__init__(rt, frame, settings.samples, settings.rays, settings.cells, seed)
        self.settings = settings
        self.half = rt.matrix_dtype
        self.gradient_scale = 1.0 if self.half == np.float32 else HALF_SCALE
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
        # Xavier's limits keep the size of what passes through a layer.
        shapes = network_layers(2 * levels)
        layers = [rng.uniform(-1, 1, s) * math.sqrt(6 / (s[0] + s[1])) for s in shapes]
        self.layers = Parameters(rt, np.concatenate([w.ravel() for w in layers]), self.half)
        self.features, self.d_features = (
            rt.zeros((settings.samples, 2 * levels), self.half) for _ in range(2)
        )
        self.memory = rt.zeros(network_room(2 * levels, settings.samples, self.half == np.float16))
        self._rate, self._factor, self._parts_of_norm = (rt.zeros((n,)) for n in (3, 1, 1024))

    def evaluate_density(self, total: Any) -> None:
        """See :meth:`SampledField.evaluate_density`."""
        self._encode(total)
        self.rt.radiance_network.density(
            self.features, total, self.layers.copy, self.memory, self.sigma
        )

    def evaluate(self, rays: Rays) -> None:
        """See :meth:`SampledField.evaluate`."""
        self._encode(self.samples.total)
        self._inputs = (
            self.features, rays.directions, self.samples.rays, self.samples.total, self.layers.copy,
        )  # fmt: skip
        self.rt.radiance_network.forward(*self._inputs, self.memory, self.sigma, self.rgb)

    def evaluate_backward(self) -> None:
        """See :meth:`SampledField.evaluate_backward`."""
        s = self.samples
        self.rt.radiance_network.backward(
            self.d_sigma, self.d_rgb, *self._inputs, self.sigma, self.rgb, self.memory,
            self.d_features, self.layers.gradients,
        )  # fmt: skip
        self.rt.radiance_hash.backward(
            s.positions, s.total, *self.grids, self.d_features, self.table.gradients
        )

    def _encode(self, total: Any) -> None:
        positions = self.samples.positions
        self.rt.radiance_hash.encode(positions, total, *self.grids, self.table.copy, self.features)

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
