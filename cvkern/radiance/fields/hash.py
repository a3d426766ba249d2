"""A hash encoding and two small perceptrons: instant neural graphics primitives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cvkern._checks import check_integer, check_number
from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import (
    LIGHT,
    AdamRule,
    CameraSet,
    NetworkInputs,
    network_layers,
    network_room,
)
from cvkern.radiance.fields.field import Frame, Learning
from cvkern.radiance.fields.parameters import LIFT, Clip, Parameters
from cvkern.radiance.march import (
    CELLS,
    STEPS,
    SampledField,
    Samples,
    check_batch,
    check_occupancy,
    check_shapes,
)

BETAS, EPSILON = (0.9, 0.99), 1e-15
MOST_LIT = 24  # levels with lights: shared memory holds no more weights
FINEST = 2**20  # cells along a side; kernels number them with 20 bits
CELLS_OF_PIXEL = (
    1.5  # cells of the finest grid per pixel; more make held-out views of small photographs worse
)

# Weight decay of the tables for so many pixels of all photographs. The rule was chosen on made
# scenes of 400 and 800 pixels a side, lego of 200, and fox: the decay of lego costs 0.8 dB for 44
# photographs of 800 pixels a side, and that of these 0.2 dB on lego.
DECAY, DECAY_PIXELS = 1e-7, 4e6


@dataclass(frozen=True)
class HashField:
    """Settings of a field of hashed features.

    A sample's features come from tables, one for each of several grids from coarse to fine. A small
    perceptron computes a density and 16 numbers from the features; a second one computes a colour
    from these numbers and the viewing direction. The defaults are for a GPU; ``fit(scene, "hash")``
    uses smaller settings on the CPU.

    Raises
    ------
    TypeError
        If a number has the wrong type.
    ValueError
        If a number is out of its range, `levels` or `cells` are not multiples of 8, `finest` is
        below `coarsest`, or `samples` below `steps`.

    References
    ----------
    .. [1] T. Mueller, A. Evans, C. Schied and A. Keller, "Instant neural graphics primitives with
       a multiresolution hash encoding", ACM Transactions on Graphics 41(4), 2022.
    """

    levels: int = 16
    """Number of grids, a multiple of 8."""
    table_bits: int = 19
    """Base-2 logarithm of the number of entries of a grid's table."""
    coarsest: int = 16
    """Cells of the coarsest grid along a side."""
    finest: int | None = None
    """Cells of the finest grid along a side, up to 2^20.

    By default three cells per two pixels of the photographs.
    """
    samples: int = 2**18
    """Samples of a batch; at least as many as `steps`."""
    rays: int = 2**14
    """Largest number of rays of a batch."""
    cells: int = CELLS
    """Cells of the occupancy grid along a side, a multiple of 8."""
    steps: int = STEPS
    """Samples along the diagonal of the scene's cube if none of it is empty, up to 1024."""
    learning_rate: float = 1e-2
    """Learning rate after a warm-up of 100 steps."""
    final_rate: float = 0.03
    """Learning rate at the end, as a share of `learning_rate`."""
    weight_decay: float = 0.0
    """Weight decay of the perceptrons."""
    table_decay: float | None = None
    """Weight decay of the tables. Entries that no photograph needs return to 0, which improves
    held-out views.

    By default 1e-7 up to 4 million pixels in all photographs of the training, and inversely
    proportional to their number beyond.
    """
    gradient_clip: float | None = None
    """Largest norm, > 0, of all gradients together; larger gradients are scaled down to it.

    The gradients are those of the sum of the losses of a batch's rays, divided by 4096.
    """

    def __post_init__(self) -> None:
        if check_integer(self.levels, "levels", 8, 32) % 8:
            raise ValueError(f"levels must be a multiple of 8, got {self.levels}")
        check_integer(self.table_bits, "table_bits", 3, 24)
        check_integer(self.coarsest, "coarsest", 1, 2**14)
        if self.finest is not None:
            check_integer(self.finest, "finest", self.coarsest, FINEST)
        check_batch(self)
        if self.table_decay is not None:
            check_number(self.table_decay, "table_decay", low=0.0)

    def grids(self, frame: Frame) -> tuple[np.ndarray, np.ndarray]:
        """Return the cells of the grids along a side, and the first entry of each in the table.

        The number of all entries is the last item of the second array. Both are int32.
        """
        finest = self.finest
        if finest is None:
            # Unbounded space is contracted into a cube of twice the side.
            side = 4 if frame.bounds.unbounded else 2
            wanted = round(min(CELLS_OF_PIXEL * side / frame.pixel, FINEST))
            finest = max(2 * self.coarsest, wanted)
        growth = (finest / self.coarsest) ** (1 / max(self.levels - 1, 1))
        resolutions = np.round(self.coarsest * growth ** np.arange(self.levels)).astype(np.int32)
        corners = (resolutions.astype(np.int64) + 1) ** 3
        sizes = np.minimum(-(-corners // 8) * 8, 2**self.table_bits)
        return resolutions, np.concatenate(([0], np.cumsum(sizes))).astype(np.int32)

    def check_state(self, state: Mapping[str, np.ndarray], frame: Frame) -> None:
        """Refuse a state of other sizes, before memory for it is allocated."""
        check_occupancy(self, state, frame)
        check_shapes(state, {"table.values": (int(self.grids(frame)[1][-1]), 2)})

    def build(self, rt: Runtime, frame: Frame, seed: int, lit: bool = False) -> HashNetwork:
        """Return the field itself, with random parameters; `lit` if its light changes."""
        return HashNetwork(rt, frame, seed, self, lit)


class HashNetwork(SampledField):
    """A field with the settings of a :class:`HashField`."""

    def __init__(
        self, rt: Runtime, frame: Frame, seed: int, settings: HashField, lit: bool = False
    ):
        if lit and settings.levels > MOST_LIT:
            raise ValueError(
                f"levels must be at most {MOST_LIT} for appearance='embedding', got "
                f"{settings.levels}"
            )
        self.half, self.lit = rt.matrix_dtype, lit
        super().__init__(rt, frame, seed, settings)
        self.gradient_scale = 1.0 if self.half == np.float32 else LIFT
        levels, rng = settings.levels, np.random.default_rng(seed)
        resolutions, offsets = settings.grids(frame)
        self.grids = rt.constant(resolutions), rt.constant(offsets)
        self.table = Parameters(rt, rng.uniform(-1e-4, 1e-4, (int(offsets[-1]), 2)), self.half)
        # The limits of Glorot and Bengio keep the variance of the features through the layers.
        shapes = network_layers(2 * levels, lit)
        layers = [rng.uniform(-1, 1, s) * math.sqrt(6 / (s[0] + s[1])) for s in shapes]
        self.layers = Parameters(rt, np.concatenate([w.ravel() for w in layers]), self.half)
        self.d_features = rt.zeros((settings.samples, 2 * levels), self.half)
        room = network_room(2 * levels, settings.samples, self.half == np.float16, lit)
        self.memory = rt.zeros(room)
        if lit:
            self.d_lights = rt.zeros((settings.samples, LIGHT))
        self._rate, self._clip = rt.zeros((3,)), Clip(rt, settings.gradient_clip)
        self.decay = DECAY if settings.table_decay is None else settings.table_decay

    def begin(self, views: CameraSet) -> None:
        """See :meth:`Field.begin`."""
        if self.settings.table_decay is None:
            pixels = len(views.poses) * views.height * views.width
            self.decay = DECAY * min(1.0, DECAY_PIXELS / pixels)

    def view_room(self, rays: int) -> int:
        """See :meth:`SampledField.view_room`; in full precision it shares the layers' memory."""
        half = self.half == np.float16
        room = super().view_room(rays)
        return room if half else min(room, self.room)

    def inner(self, room: int) -> dict[str, Any]:
        """See :meth:`SampledField.inner`."""
        return {"features": self.rt.zeros((room, 2 * self.settings.levels), self.half)}

    def evaluate_density(self, total: Any) -> None:
        """See :meth:`SampledField.evaluate_density`."""
        features = self._encode(self.samples, total)
        self.rt.radiance.fields.perceptron.network.density(
            features, total, self.layers.copy, self.memory, self.samples.sigma
        )

    def evaluate(self, directions: Any, samples: Samples) -> None:
        """See :meth:`SampledField.evaluate`."""
        s = samples
        features = self._encode(s, s.total)
        lights = self.lights if self.lit else ()
        self._inputs = NetworkInputs(
            features, directions, s.rays, s.total, self.layers.copy, *lights
        )
        self.rt.radiance.fields.perceptron.network.forward(
            self._inputs, self.memory, s.sigma, s.rgb
        )

    def evaluate_backward(self) -> None:
        """See :meth:`SampledField.evaluate_backward`."""
        s = self.samples
        self.rt.radiance.fields.perceptron.network.backward(
            self.d_sigma, self.d_rgb, self._inputs, s.sigma, s.rgb, self.memory,
            self.d_features, self.d_lights, self.layers.gradients,
        )  # fmt: skip
        self.rt.radiance.fields.hash.backward(
            s.positions, s.total, *self.grids, self.d_features, self.table.sums
        )
        self.table.collect(self.rt)

    def _encode(self, samples: Samples, total: Any) -> Any:
        """Look up the features of the first `total` (1,) samples, and return them."""
        features = samples.inner["features"]
        self.rt.radiance.fields.hash.encode(
            samples.positions, total, *self.grids, self.table.copy, features
        )
        return features

    def make_deterministic(self) -> None:
        """See :meth:`Field.make_deterministic`; on a GPU, atomics add to the tables."""
        if self.rt.device != "cpu":
            self.gradient_scale = LIFT
            self.table.make_deterministic(self.rt)

    def collected(self) -> list[Any]:
        """See :meth:`Field.collected`."""
        return [self.table.gradients, self.layers.gradients]

    def learn(self, learning: Learning) -> None:
        """See :meth:`Field.learn`."""
        adam, s = self.rt.radiance.training.adam, self.settings
        adam.learning_rate(
            learning.step, learning.progress, s.learning_rate, 100, s.final_rate, *BETAS, self._rate
        )
        gradients = self.table.gradients, self.layers.gradients
        self._clip.update(learning.scale / self.gradient_scale, *gradients)
        for parameters, decay, sparse in (
            (self.table, self.decay, self.decay == 0.0),
            (self.layers, s.weight_decay, False),
        ):
            rule = AdamRule(*BETAS, EPSILON, decay, sparse)
            adam.adam(self._rate, self._clip.factor, rule, *parameters.flat())

    def state(self) -> dict[str, np.ndarray]:
        """See :meth:`Field.state`."""
        return (
            super().state()
            | self.table.state("table.", self.rt)
            | self.layers.state("layers.", self.rt)
        )

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """See :meth:`Field.restore`."""
        super().restore(state)
        self.table.restore("table.", state, self.rt)
        self.layers.restore("layers.", state, self.rt)
