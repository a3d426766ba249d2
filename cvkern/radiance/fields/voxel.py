"""A grid of densities and spherical harmonics, refined during training."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cvkern._archives import shape_of
from cvkern._checks import as_items, check_integer, check_number, check_positive
from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import (
    MOST_LOG_DENSITY,
    AdamRule,
    Composited,
    Grid,
    Learnt,
    March,
    Rays,
    Space,
)
from cvkern.radiance.fields.field import Field, Frame, Learning, View
from cvkern.radiance.fields.parameters import Clip, flat
from cvkern.radiance.march import STOP, check_shapes, taken

BETAS, EPSILON = (0.9, 0.99), 1e-15
WARMUP = 20  # steps until the learning rates reach their full value
EVERY = 16  # steps between updates of the empty space
BLOCK = 4  # cells of the grid along a side of an occupancy cell
LANES = 16  # the coefficients of a node are padded to a multiple of this
LIFT = 4096.0  # `Field.gradient_scale` if fixed-point numbers hold gradients
MEANS = "density.mean", "density.square", "color.mean", "color.square"  # names in a state
MOST_CELLS = 400  # a larger grid has too many numbers for 32-bit indices


@dataclass(frozen=True)
class VoxelField:
    """Settings of a field that is a grid.

    Each node has a logarithm of density and, for each channel of the colour, coefficients of
    spherical harmonics. These are interpolated between nodes; then the exponential function gives
    the density, and the logistic function the colour. Training begins with a coarse grid.

    Raises
    ------
    TypeError
        If a number has the wrong type.
    ValueError
        If a number is out of its range; if `resolutions` do not ascend, are not multiples of 16,
        or are above 400; if `shares` are not one per change of the resolution, ascending between 0
        and 1; if samples are closer than a 500th of half the cube's side; or if `first` is so
        small that it counts as empty.

    Notes
    -----
    On the CPU the same steps give the same model, bit for bit, with any number of threads. On CUDA
    the order in which gradients are added varies from run to run, unless training is
    deterministic.

    A grid of N cells along a side takes 0.5 kB for each of its (N + 1)^3 nodes: 1.1 GB for 128.
    Files hold only the nodes that training has changed: 80 MB for the Blender scene lego, or 26 MB
    for rendering only.

    References
    ----------
    .. [1] A. Yu, S. Fridovich-Keil, M. Tancik, Q. Chen, B. Recht and A. Kanazawa, "Plenoxels:
       radiance fields without neural networks", CVPR 2022.
    """

    resolutions: tuple[int, ...] = (32, 64, 128)
    """Cells along a side, for each of the successive grids."""
    shares: tuple[float, ...] = (0.1, 0.3)
    """Shares of the training after which the next grid begins."""
    degree: int = 2
    """Degree of the spherical harmonics, at most 2; with 0, colour does not depend on direction."""
    rays: int = 2048
    """Rays of a batch."""
    spacing: float = 0.5
    """Distance between samples, in cells."""
    first: float = 0.5
    """Initial density, per half of the cube's side; small, so that light gets through."""
    thin: float = 1e-3
    """A sample counts as empty if its density times length is below this."""
    density_rate: float = 0.2
    """Learning rate of the logarithms of density."""
    color_rate: float = 0.1
    """Learning rate of the coefficients."""
    final_rate: float = 0.1
    """Learning rates at the end, as a share of those at the beginning."""
    smooth_density: float = 0.0
    """Weight of half the squared differences of the logarithm of density between neighbours."""
    smooth_color: float = 1e-9
    """Weight of half the squared differences of the coefficients between neighbours."""
    gradient_clip: float | None = None
    """Largest norm, > 0, of all gradients together; larger gradients are scaled down to it.

    The gradients are those of the sum of the losses of a batch's rays, divided by 4096, and of the
    smoothness. Computing their norm reads the whole grid in each step.
    """

    def __post_init__(self) -> None:
        sides = as_items(self.resolutions, "resolutions", "a sequence of integers")
        found = [check_integer(n, "resolutions", 16, MOST_CELLS) for n in sides]
        shares = [
            check_number(share, "shares")
            for share in as_items(self.shares, "shares", "a sequence of numbers")
        ]
        object.__setattr__(self, "resolutions", tuple(found))
        object.__setattr__(self, "shares", tuple(shares))
        if not found or found != sorted(set(found)) or any(n % 16 for n in found):
            raise ValueError(f"resolutions must be growing multiples of 16, got {tuple(found)}")
        if len(shares) != len(found) - 1:
            raise ValueError(f"shares must be {len(found) - 1} numbers, got {len(shares)}")
        if any(b <= a for a, b in itertools.pairwise((0.0, *shares, 1.0))):
            raise ValueError(f"shares must grow between 0 and 1, got {tuple(shares)}")
        check_integer(self.degree, "degree", 0, 2)
        check_integer(self.rays, "rays", 1, 2**24)
        for name in ("spacing", "first", "thin", "density_rate", "color_rate", "final_rate"):
            check_positive(getattr(self, name), name)
        for name in ("smooth_density", "smooth_color"):
            check_number(getattr(self, name), name, low=0.0)
        if self.gradient_clip is not None:
            check_positive(self.gradient_clip, "gradient_clip")
        least = found[-1] / 1000  # float32 resolves such steps even for the farthest cameras
        if self.spacing < least:
            raise ValueError(f"spacing must be at least {least:g} cells, got {self.spacing:g}")
        thin = self.thin * found[0] / (2 * self.spacing)  # the density that counts as empty
        if self.first <= thin:
            raise ValueError(
                f"first must be above {thin:g}, which counts as empty, got {self.first}"
            )

    def check_state(self, state: Mapping[str, np.ndarray], frame: Frame) -> None:
        """Refuse a state of another resolution, before memory for it is allocated."""
        sides = [(n + 1,) * 3 for n in self.resolutions]
        if "density" not in state:
            raise ValueError(f"state must have 'density', got {tuple(state)}")
        shape = shape_of(state, "density")
        if shape not in sides:
            raise ValueError(f"density must have a shape of {sides}, got {shape}")
        most, width = math.prod(shape), 3 * (self.degree + 1) ** 2
        count = math.prod(shape_of(state, "nodes")) if "nodes" in state else 0
        if count > most:
            raise ValueError(f"nodes must be at most {most}, got {count}")
        check_shapes(state, {
            "nodes": (count,), **dict.fromkeys(MEANS[:2], (count, 1)),
            **dict.fromkeys((*MEANS[2:], "color"), (count, width)),
        })  # fmt: skip

    def build(self, rt: Runtime, frame: Frame, seed: int) -> VoxelGrid:
        """Return the field itself, initially a uniform grey fog."""
        return VoxelGrid(rt, frame, seed, self)


class VoxelGrid(Field):
    """A field with the settings of a :class:`VoxelField`."""

    def __init__(self, rt: Runtime, frame: Frame, seed: int, settings: VoxelField):
        self.rt, self.frame, self.seed, self.settings = rt, frame, seed, settings
        self.rays = self.first_rays = rays = settings.rays
        self.basis = (settings.degree + 1) ** 2
        self.rendered = Composited(
            rt.zeros((rays, 3)), rt.zeros((rays,)), rt.zeros((rays,)), rt.zeros((rays,))
        )
        self.samples = rt.zeros((rays,), np.int32)
        self._rates, self._clip = (rt.zeros((3,)), rt.zeros((3,))), Clip(rt, settings.gradient_clip)
        self._exact = False
        self._open(0)
        first = np.full(self.density.shape, math.log(settings.first), np.float32)
        rt.write(self.density, first)
        self._mark()

    def _open(self, level: int) -> None:
        """Allocate memory for the grid of one resolution."""
        rt, s = self.rt, self.settings
        self.level, self.resolution = level, s.resolutions[level]
        self.edition += 1
        side = (self.resolution + 1,) * 3
        width = -(-3 * self.basis // LANES) * LANES
        self.density, self.d_density, *self._density_means = (rt.zeros(side) for _ in range(4))
        self.color, self.d_color, *self._color_means = (rt.zeros((*side, width)) for _ in range(4))
        self._sums = self._take_sums()
        self.touched = rt.zeros(side, np.uint8)
        self.cells = self.resolution // BLOCK
        self.bits = rt.zeros((self.cells**3 // 32,), np.uint32)
        unbounded = self.frame.bounds.unbounded
        self.finest = (4 if unbounded else 2) * s.spacing / self.resolution
        # Cells of contracted space grow at least in proportion to the distance.
        self.cone = self.finest if unbounded else 0.0
        self.least = math.log(s.thin / self.finest)

    def _take_sums(self) -> tuple[Any, Any]:
        """Return the arrays to which the gradients of density and colour are added."""
        if not self._exact:
            return self.d_density, self.d_color
        density, color = (self.rt.zeros(a.shape, np.int64) for a in (self.density, self.color))
        return density, color

    def make_deterministic(self) -> None:
        """See :meth:`Field.make_deterministic`; on a GPU, atomics add to the grid."""
        if self.rt.device != "cpu":
            self._exact, self.gradient_scale = True, LIFT
            self._sums = self._take_sums()

    def _marched(
        self, rays: Rays, step: Any, training: bool
    ) -> tuple[Rays, Space, March, Grid, float]:
        """Return the arguments that the forward and backward passes share."""
        frame = self.frame
        span = frame.near, frame.far, self.finest, self.cone
        return (
            rays,
            Space(self.bits, 1, self.cells, frame.bounds.unbounded),
            March(*span, 2**31 - 1, training, self.seed, step),
            Grid(self.density, self.color, self.basis, self.least),
            STOP,
        )

    def see(self, origins: Any, directions: Any, seen: View, row: int = 0) -> None:
        """See :meth:`Field.see`."""
        rt, count = self.rt, origins.shape[0]
        active = rt.constant(np.array([2**31 - 1], np.int32))
        distortion = rt.scratch("view.distortion", (count,))
        samples = rt.scratch("view.samples", (count,), np.int32)
        # Any step will do: without training, no random positions are drawn.
        marched = self._marched(Rays(origins, directions, active), active, False)
        rt.radiance.fields.voxel.rays.render(*marched, Composited(*seen, distortion), samples)

    def forward(self, rays: Rays, step: Any) -> Composited:
        """See :meth:`Field.forward`."""
        self._last = self._marched(rays, step, True)
        self.rt.radiance.fields.voxel.rays.render(*self._last, self.rendered, self.samples)
        return self.rendered

    def backward(self, gradients: Composited) -> None:
        """See :meth:`Field.backward`."""
        self.rt.radiance.fields.voxel.rays.render_backward(
            gradients, *self._last, self.rendered, self.samples, *self._sums, self.touched
        )
        if self._exact:
            for sums, array in zip(self._sums, (self.d_density, self.d_color), strict=True):
                self.rt.radiance.training.adam.collect(flat(sums), flat(array))

    def collected(self) -> list[Any]:
        """See :meth:`Field.collected`."""
        return [self.d_density, self.d_color, self.touched]

    def learn(self, learning: Learning) -> None:
        """See :meth:`Field.learn`."""
        s, nodes = self.settings, self.rt.radiance.fields.voxel.nodes
        scale = learning.scale / self.gradient_scale
        for rate, base in zip(self._rates, (s.density_rate, s.color_rate), strict=True):
            self.rt.radiance.training.adam.learning_rate(
                learning.step, learning.progress, base, WARMUP, s.final_rate, *BETAS, rate
            )
        if s.smooth_density or s.smooth_color:
            nodes.total_variation(
                s.smooth_density / scale, s.smooth_color / scale, self.touched, self.density,
                self.color, self.d_density, self.d_color,
            )  # fmt: skip
        self._clip.update(scale, self.d_density, self.d_color)
        (mean, square), (color_mean, color_square) = self._density_means, self._color_means
        density = Learnt(self.d_density, mean, square, self.density)
        color = Learnt(self.d_color, color_mean, color_square, self.color)
        rule = AdamRule(*BETAS, EPSILON)
        nodes.adam(*self._rates, self._clip.factor, rule, self.touched, density, color)

    def taken(self) -> int:
        """See :meth:`Field.taken`; only samples that are not empty count."""
        return int(self.rt.to_numpy(self.samples).sum())

    def rays_for(self, samples: int, rays: int) -> int:
        """See :meth:`Field.rays_for`; samples take no memory here, so the number is fixed."""
        return self.rays

    def densities(self, points: np.ndarray) -> np.ndarray:
        """See :meth:`Field.densities`."""
        from scipy.ndimage import map_coordinates

        places, unbounded = np.asarray(points, np.float64), self.frame.bounds.unbounded
        if unbounded:
            size = np.maximum(np.linalg.norm(places, axis=1, keepdims=True), 1.0)
            places = places * ((2 - 1 / size) / size) / 2
        at = (places[:, ::-1].T + 1) * (self.resolution / 2)
        raw = map_coordinates(self.rt.to_numpy(self.density), at, order=1, mode="nearest")
        inside = (np.abs(places) <= 1).all(axis=1)
        found = np.where(
            inside & (raw > self.least), np.exp(np.minimum(raw, MOST_LOG_DENSITY)), 0.0
        )
        return found.astype(np.float32)

    def tend(self, step: int, learning: Learning) -> None:
        """Periodically update the empty space, and refine the grid when it is time."""
        if step % EVERY:
            return
        progress, shares = float(self.rt.to_numpy(learning.progress)[0]), self.settings.shares
        while self.level < len(shares) and progress >= shares[self.level]:
            self._refine()
        self._mark()

    def _refine(self) -> None:
        """Continue with the next grid; colours that no ray can see are reset."""
        density, color, least = self.density, self.color, self.least
        self._open(self.level + 1)
        upsample = self.rt.radiance.fields.voxel.nodes.upsample
        upsample(density, -math.inf, _rows(density), _rows(self.density))
        upsample(density, least, color, self.color)

    def _mark(self) -> None:
        self.rt.radiance.fields.voxel.nodes.mark(self.density, self.cells, self.least, self.bits)

    def state(self) -> dict[str, np.ndarray]:
        """See :meth:`Field.state`: all densities, and the other arrays where they are not 0."""
        arrays = {name: self.rt.to_numpy(a) for name, a in self._arrays().items()}
        rows = [a.reshape(self.density.size, -1) for a in arrays.values()]
        nodes = np.flatnonzero(np.logical_or.reduce([a.any(axis=1) for a in rows]))
        # Leave out the padding of the coefficients.
        found = {k: a[nodes, : 3 * self.basis] for k, a in zip(arrays, rows, strict=True)}
        density = self.rt.to_numpy(self.density).copy()
        return {"density": density, "nodes": nodes.astype(np.int32)} | found

    def to_render(self, state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """See :meth:`Field.to_render`; leaves out nodes of which all cells are empty."""
        from scipy.ndimage import maximum_filter

        seen = maximum_filter(state["density"], 3).ravel()[state["nodes"]] > self.least
        return super().to_render({k: a if k == "density" else a[seen] for k, a in state.items()})

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """See :meth:`Field.restore`."""
        self.settings.check_state(state, self.frame)
        shape = shape_of(state, "density")
        self._open(self.settings.resolutions.index(shape[0] - 1))
        self.rt.write(self.density, taken(state, "density", shape))
        most, (count,) = math.prod(shape), shape_of(state, "nodes")
        nodes = taken(state, "nodes", (count,), np.int32)
        if count and not 0 <= nodes.min() <= nodes.max() < most:
            raise ValueError(f"nodes must be numbers of nodes, got {nodes.min()} to {nodes.max()}")
        in_place = self.rt.device == "cpu"  # pages that are never written take no memory
        for name, array in self._arrays().items():
            values = self.rt.to_numpy(array) if in_place else np.zeros(array.shape, np.float32)
            rows = values.reshape(math.prod(shape), -1)[:, : 3 * self.basis]
            rows[nodes] = taken(state, name, (len(nodes), rows.shape[1]))
            if not in_place:
                self.rt.write(array, values)
        self._mark()

    def _arrays(self) -> dict[str, Any]:
        """Return the arrays of nodes that are saved, except the densities."""
        arrays = (*self._density_means, *self._color_means, self.color)
        return dict(zip((*MEANS, "color"), arrays, strict=True))


def _rows(array: Any) -> Any:
    """View (N, N, N) as (N, N, N, 1)."""
    return array.reshape((*array.shape, 1))
