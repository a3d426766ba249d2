"""One deep perceptron of encoded positions and directions: the original radiance field."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_integer
from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import LIGHT, AdamRule
from cvkern.radiance.fields.field import Frame, Learning
from cvkern.radiance.fields.parameters import LIFT, Clip, Parameters
from cvkern.radiance.march import SampledField, Samples, check_batch, check_occupancy

BETAS, EPSILON, WARMUP = (0.9, 0.999), 1e-8, 100
VIEW_ROOM = 2**17  # samples of a round of rendering on a GPU, 5 kB each
PIECE = 16  # numbers of features are multiples of this, as tensor cores need
MOST_FREQUENCIES, MOST_WIDTH = 14, 256  # a layer's weights must fit into shared memory


@dataclass(frozen=True)
class MLPField:
    """Settings of the field of the first paper on neural radiance fields.

    Layers with rectifiers map the encoded position (see :func:`positional_encoding`) to `width`
    features. The first feature is the logarithm of the density. A layer of half the width computes
    the colour from all features and the encoded viewing direction. The field is small on disk and
    slow: nearly all of its 600 000 weights are used for every sample. The defaults are for a GPU;
    ``fit(scene, "mlp")`` uses smaller settings on the CPU.

    Raises
    ------
    TypeError
        If a number has the wrong type.
    ValueError
        If a number is out of its range, `width` is not a multiple of 16, `cells` is not a multiple
        of 8, or `samples` is below `steps`.

    Notes
    -----
    This field differs from [1]_ in three points. An occupancy grid, instead of a second, coarse
    network, decides where samples are taken. The density is an exponential, not a rectifier. Layers
    have no biases; instead, the encodings have a feature that is always 1. Positions are encoded in
    the cube from 0 to 1.

    References
    ----------
    .. [1] B. Mildenhall, P. P. Srinivasan, M. Tancik, J. T. Barron, R. Ramamoorthi and R. Ng,
       "NeRF: representing scenes as neural radiance fields for view synthesis", ECCV 2020.

    Examples
    --------
    Small settings that suit a CPU:

    >>> from cvkern.radiance import MLPField, fit, make_scene
    >>> small = MLPField(width=64, layers=4, skip=2, frequencies=6, samples=2**12, rays=2**9,
    ...                  cells=32, steps=128, learning_rate=5e-3)
    >>> fit(make_scene(train=3, test=1, size=16), small, steps=2).training.step
    2
    """

    width: int = 256
    """Features of a layer, a multiple of 16 up to 256."""
    layers: int = 8
    """Number of layers before the density."""
    skip: int = 5
    """Layer whose output is concatenated with the encoded position; 0 for none."""
    frequencies: int = 10
    """Frequencies of the encoded position, from 1 to 14."""
    view_frequencies: int = 4
    """Frequencies of the encoded direction, from 1 to 14."""
    samples: int = 2**16
    """Samples of a batch; at least as many as `steps`. With the other defaults, each takes 16 kB on
    the CPU, and half of that on a GPU."""
    rays: int = 2**12
    """Largest number of rays of a batch."""
    cells: int = 64
    """Cells of the occupancy grid along a side, a multiple of 8."""
    steps: int = 512
    """Samples along the diagonal of the scene's cube if none of it is empty, up to 1024."""
    learning_rate: float = 5e-4
    """Learning rate after a warm-up of 100 steps."""
    final_rate: float = 0.1
    """Learning rate at the end, as a share of `learning_rate`."""
    weight_decay: float = 0.0
    """Weight decay of all weights."""
    gradient_clip: float | None = None
    """Largest norm, > 0, of all gradients together; larger gradients are scaled down to it.

    The gradients are those of the sum of the losses of a batch's rays, divided by 4096.
    """

    def __post_init__(self) -> None:
        if check_integer(self.width, "width", PIECE, MOST_WIDTH) % PIECE:
            raise ValueError(f"width must be a multiple of {PIECE}, got {self.width}")
        check_integer(self.layers, "layers", 1, 64)
        check_integer(self.skip, "skip", 0, self.layers - 1)
        check_integer(self.frequencies, "frequencies", 1, MOST_FREQUENCIES)
        check_integer(self.view_frequencies, "view_frequencies", 1, MOST_FREQUENCIES)
        check_batch(self)

    def check_state(self, state: Mapping[str, np.ndarray], frame: Frame) -> None:
        """Refuse a state of other sizes, before memory for it is allocated."""
        check_occupancy(self, state, frame)

    def build(self, rt: Runtime, frame: Frame, seed: int, lit: bool = False) -> MLPNetwork:
        """Return the field itself, with random parameters; `lit` if its light changes."""
        return MLPNetwork(rt, frame, seed, self, lit)


class Layer(NamedTuple):
    """A layer: the product of one matrix of features, written into another."""

    source: str
    depth: int
    """Number of columns of the source that it reads, beginning with the first."""
    target: str
    column: int
    """Column of the target for the first result."""
    columns: int
    relu: bool


def encoded(frequencies: int) -> int:
    """Return the number of columns of three encoded coordinates and a constant."""
    return -(-(3 + 6 * frequencies + 1) // PIECE) * PIECE


def light_column(settings: MLPField) -> int:
    """Return the number of inputs of the colour layer before the light of the photograph."""
    return settings.width + encoded(settings.view_frequencies)


def plan(settings: MLPField, lit: bool = False) -> list[Layer]:
    """Return the layers, first to last.

    The encoded position is in the first columns of "position", and the output of layer `skip`
    follows it, so that the next layer reads both without a copy. "view" has the features of the
    last layer, followed by the encoded direction, and by the light of the photograph if `lit`.
    """
    s, place = settings, encoded(settings.frequencies)
    found, source, depth = [], "position", place
    for number in range(1, s.layers + 1):
        target, column = ("position", place) if number == s.skip else (f"layer {number}", 0)
        found.append(Layer(source, depth, target, column, s.width, True))
        source, depth = target, column + s.width
    half = -(-s.width // (2 * PIECE)) * PIECE
    return [
        *found,
        Layer(source, depth, "view", 0, s.width, False),
        Layer("view", light_column(s) + LIGHT * lit, "color", 0, half, True),
        Layer("color", half, "raw", 0, PIECE, False),
    ]


def initial(layers: list[Layer], seed: int) -> list[np.ndarray]:
    """Return random weights that keep the variance of the features through the layers.

    They are uniform within the limit of He et al. 2015 for layers with rectifiers, and within that
    of Glorot and Bengio 2010 for the others.
    """
    rng = np.random.default_rng(seed)
    limits = [math.sqrt(6 / (a.depth if a.relu else a.depth + a.columns)) for a in layers]
    return [
        limit * rng.uniform(-1, 1, (a.depth, a.columns))
        for limit, a in zip(limits, layers, strict=True)
    ]


class MLPNetwork(SampledField):
    """A field with the settings of an :class:`MLPField`."""

    def __init__(self, rt: Runtime, frame: Frame, seed: int, settings: MLPField, lit: bool = False):
        self.layers, self.half, self.lit = plan(settings, lit), rt.matrix_dtype, lit
        self.widths: dict[str, int] = {}
        for a in self.layers:
            self.widths[a.source] = max(self.widths.get(a.source, 0), a.depth)
            self.widths[a.target] = max(self.widths.get(a.target, 0), a.column + a.columns)
        super().__init__(rt, frame, seed, settings)
        self.gradient_scale = 1.0 if self.half == np.float32 else LIFT
        weights = initial(self.layers, seed)
        self.parameters = Parameters(rt, np.concatenate([w.ravel() for w in weights]), self.half)
        ends = np.cumsum([w.size for w in weights])
        parts = [(slice(e - w.size, e), w.shape) for e, w in zip(ends, weights, strict=True)]
        self.weights, self.d_weights = (
            [flat[part].reshape(shape) for part, shape in parts]
            for flat in (self.parameters.copy, self.parameters.gradients)
        )
        # A layer's backward pass reads the gradients of one matrix and writes those of the matrix
        # before, so two buffers per width, used in turns, hold all gradients.
        places = {name: (n % 2, width) for n, (name, width) in enumerate(self.widths.items())}
        pool = {p: rt.zeros((settings.samples, p[1]), self.half) for p in set(places.values())}
        self.gradients = {name: pool[place] for name, place in places.items()}
        if lit:
            self.d_lights = rt.zeros((settings.samples, LIGHT))
        self._rate, self._clip = rt.zeros((3,)), Clip(rt, settings.gradient_clip)

    def inner(self, room: int) -> dict[str, Any]:
        """See :meth:`SampledField.inner`: the inputs and outputs of the layers."""
        return {name: self.rt.zeros((room, w), self.half) for name, w in self.widths.items()}

    def view_room(self, rays: int) -> int:
        """See :meth:`SampledField.view_room`."""
        return min(super().view_room(rays), VIEW_ROOM)

    def evaluate_density(self, total: Any) -> None:
        """See :meth:`SampledField.evaluate_density`."""
        self._encode_positions(self.samples, total)
        self._forward(self.layers[:-2], self.samples, total)

    def evaluate(self, directions: Any, samples: Samples) -> None:
        """See :meth:`SampledField.evaluate`."""
        rt, count, frequencies = self.rt, directions.shape[0], self.settings.view_frequencies
        self._encode_positions(samples, samples.total)
        views = rt.scratch("mlp.views", (count, encoded(frequencies)), self.half)
        all_rays = rt.constant(np.array([count], np.int32))
        rt.radiance.encodings.positional(
            directions, all_rays, frequencies, True, True, 0, views.shape[1], views
        )
        rt.radiance.encodings.gather(
            views, samples.rays, samples.total, self.settings.width, samples.inner["view"]
        )
        if self.lit:
            rt.radiance.wild.embeddings.gather(
                self.lights.table, self.lights.views, samples.rays, samples.total,
                light_column(self.settings), samples.inner["view"],
            )  # fmt: skip
        self._forward(self.layers, samples, samples.total)

    def _encode_positions(self, samples: Samples, total: Any) -> None:
        frequencies = self.settings.frequencies
        self.rt.radiance.encodings.positional(
            samples.positions, total, frequencies, True, True, 0, encoded(frequencies),
            samples.inner["position"],
        )  # fmt: skip

    def _forward(self, layers: list[Layer], samples: Samples, total: Any) -> None:
        """Apply the layers, then turn the last two outputs into density and colour."""
        rt, v = self.rt, samples.inner
        for a, w in zip(layers, self.weights, strict=False):
            rt.radiance.fields.perceptron.layers.forward(
                v[a.source], w, total, a.relu, a.column, v[a.target]
            )
        rt.radiance.fields.perceptron.heads.forward(
            v["view"], v["raw"], total, samples.sigma, samples.rgb
        )

    def evaluate_backward(self) -> None:
        """See :meth:`SampledField.evaluate_backward`."""
        rt, s, g, total = self.rt, self.samples, self.gradients, self.samples.total
        rt.radiance.fields.perceptron.heads.color_backward(self.d_rgb, s.rgb, total, g["raw"])
        for number in range(len(self.layers) - 1, -1, -1):
            a, w = self.layers[number], self.weights[number]
            x, dy = s.inner[a.source], g[a.target]
            rt.radiance.fields.perceptron.layers.backward_weight(
                dy, x, total, a.column, self.d_weights[number]
            )
            if number:  # positions have no gradients
                # Only outputs of rectifiers are gated, not the features before the colour layer.
                gated = a.source != "view"
                rt.radiance.fields.perceptron.layers.backward_input(
                    dy, w, x, total, gated, a.column, g[a.source]
                )
            if a.source == "view" and self.lit:
                rt.radiance.wild.embeddings.copy(
                    g["view"], total, light_column(self.settings), self.d_lights
                )
            if a.source == "view":
                rt.radiance.fields.perceptron.heads.density_backward(
                    self.d_sigma, s.sigma, total, g["view"]
                )

    def collected(self) -> list[Any]:
        """See :meth:`Field.collected`."""
        return [self.parameters.gradients]

    def learn(self, learning: Learning) -> None:
        """See :meth:`Field.learn`."""
        adam, s = self.rt.radiance.training.adam, self.settings
        adam.learning_rate(
            learning.step, learning.progress, s.learning_rate, WARMUP, s.final_rate, *BETAS,
            self._rate,
        )  # fmt: skip
        self._clip.update(learning.scale / self.gradient_scale, self.parameters.gradients)
        adam.adam(
            self._rate, self._clip.factor, AdamRule(*BETAS, EPSILON, s.weight_decay),
            *self.parameters.flat(),
        )  # fmt: skip

    def state(self) -> dict[str, np.ndarray]:
        """See :meth:`Field.state`."""
        return super().state() | self.parameters.state("layers.", self.rt)

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """See :meth:`Field.restore`."""
        super().restore(state)
        self.parameters.restore("layers.", state, self.rt)
