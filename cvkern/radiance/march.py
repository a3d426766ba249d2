"""Fields that are evaluated in batches of samples: march rays, evaluate samples, composite."""

from __future__ import annotations

import abc
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from cvkern._archives import shape_of
from cvkern._checks import check_integer, check_number, check_positive
from cvkern._runtime import Runtime
from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.codes.radiance import Composited, Lights, March, Rays, Space, Views
from cvkern.radiance.fields.field import Field, Frame, Learning, View

CELLS = 128  # cells of the occupancy grid along a side, in each level
LEVELS = 5  # levels in unbounded space: the outermost cube is 16 times as large
STEPS = 1024  # most samples along the diagonal of the innermost cube, and on any ray
CONE = 1 / 256  # distance between samples of unbounded space, as a share of their distance
STOP = 1e-4  # share of the light at which a ray ends
FILL = 0.92  # share of the room for samples that a batch should fill
EVERY = 16  # steps between updates of the occupancy grid
SETTLED = 256  # steps after which only a part of the grid is updated each time
FADE = 0.95
OPTICAL_THICKNESS = 0.01  # optical thickness of a step above which a cell is always occupied
VIEW_ROOM = 2**22  # most samples of a round of rendering on a GPU
VIEW_EACH = 16  # samples per ray of a view in a round, if this gives fewer
VIEW_FEW = 64  # most samples of a ray in a round, because it may soon be opaque
PARTS = 16  # sizes that the room can be cut to, because small rounds cost less


class Samples(NamedTuple):
    """Samples along rays, as kernel arrays with room for M."""

    total: Any
    """Number of the samples, (1,) int32."""
    positions: Any
    """Positions in the cube from 0 to 1, (M, 3) float32."""
    distances: Any
    """Distance from the camera, and length of the step, (M, 2) float32."""
    rays: Any
    """Ray of each sample, (M,) int32."""
    sigma: Any
    """Density, (M,) float32."""
    rgb: Any
    """Colour, (M, 3) float32."""
    inner: dict[str, Any]
    """Intermediate results of the field, M rows each."""

    def first(self, rows: int) -> Samples:
        """Return the first rows of all arrays."""
        arrays = {name: getattr(self, name)[:rows] for name in self._fields[1:-1]}
        inner = {name: a[:rows] for name, a in self.inner.items()}
        return self._replace(**arrays, inner=inner)


class Viewing:
    """Room for the samples of a round of rendering."""

    def __init__(self, samples: Samples, counts: Any):
        self.samples, self.counts = samples._replace(total=counts[:1]), counts
        self.room = samples.positions.shape[0]
        self._parts: dict[int, Samples] = {}

    def first(self, count: int) -> Samples:
        """Return room for at least `count` samples, in one of a few sizes."""
        part = -(-self.room // PARTS)
        rows = min(-(-count // part) * part, self.room)
        if rows not in self._parts:
            self._parts[rows] = self.samples.first(rows)
        return self._parts[rows]


class SampledField(Field):
    """A field that computes density and colour of a batch of samples; this class does the rest."""

    can_look_aside = True
    d_lights: Any = None
    """Gradients of the last :meth:`backward` by the light of each sample, (M, 16), if lit."""

    def __init__(self, rt: Runtime, frame: Frame, seed: int, settings: Any):
        """Allocate a batch of the `settings`, which :func:`check_batch` has checked."""
        self.rt, self.frame, self.seed, self.settings = rt, frame, seed, settings
        room, rays, cells = settings.samples, settings.rays, settings.cells
        self.room, self.rays, self.cells = room, rays, cells
        self.first_rays = min(rays, room // settings.steps)
        unbounded = frame.bounds.unbounded
        self.levels = LEVELS if unbounded else 1
        self.finest = 2 * math.sqrt(3) / settings.steps
        self.cone = CONE if self.levels > 1 else 0.0
        count = self.levels * cells**3
        self.density = rt.zeros((count,))
        self.bits = rt.zeros((count // 32,), np.uint32)
        rt.write(self.bits, np.full(count // 32, 0xFFFFFFFF, np.uint32))
        self.space = Space(self.bits, self.levels, cells, unbounded)
        self._parts, self._limit = rt.zeros((1024,)), rt.zeros((1,))
        self._visited = rt.zeros((room,), np.int32)
        self._all = rt.zeros((1,), np.int32)
        rt.write(self._all, np.array([room], np.int32))
        self.samples = self._room_for(room, rt.zeros((1,), np.int32))
        self.spans = rt.zeros((rays, 2), np.int32)
        self.d_sigma, self.d_rgb = rt.zeros((room,)), rt.zeros((room, 3))
        self.rendered = Composited(
            rt.zeros((rays, 3)), rt.zeros((rays,)), rt.zeros((rays,)), rt.zeros((rays,))
        )
        self._updates: dict[bool, Any] = {}
        self._viewing: Viewing | None = None
        self._sides: Any = None  # directions that have nothing to do with the rays
        self.lights: Any = None  # `Lights`, or None if the field is not lit

    @abc.abstractmethod
    def inner(self, room: int) -> dict[str, Any]:
        """Allocate the intermediate results of :meth:`evaluate` for `room` samples."""

    @abc.abstractmethod
    def evaluate(self, directions: Any, samples: Samples) -> None:
        """Fill `sigma` and `rgb` of samples; `directions` (R, 3) are those of the rays."""

    @abc.abstractmethod
    def evaluate_density(self, total: Any) -> None:
        """Fill `sigma` for the first `total` positions of the field's own samples."""

    @abc.abstractmethod
    def evaluate_backward(self) -> None:
        """Add to the parameters' gradients, from `d_sigma` and `d_rgb` of the field's samples."""

    def light(self, lights: Lights) -> None:
        """See :meth:`Field.light`."""
        self.lights = lights

    def _room_for(self, room: int, total: Any) -> Samples:
        """Allocate `room` samples; `total` (1,) is the number in use."""
        rt = self.rt
        return Samples(
            total, rt.zeros((room, 3)), rt.zeros((room, 2)), rt.zeros((room,), np.int32),
            rt.zeros((room,)), rt.zeros((room, 3)), self.inner(room),
        )  # fmt: skip

    def see(self, origins: Any, directions: Any, seen: View, row: int = 0) -> None:
        """See :meth:`Field.see`."""
        count = origins.shape[0]
        room = self.view_room(count)
        if self._viewing is None or self._viewing.room < room:
            self._viewing = self._room_to_view(room)
        most = self._viewing.room  # rays at a time: each needs room for one sample
        for begin in range(0, count, most):
            part = slice(begin, min(begin + most, count))
            self._see(
                self._viewing, origins[part], directions[part], View(*(a[part] for a in seen))
            )

    def view_room(self, rays: int) -> int:
        """Return samples per round: many on a GPU, where each round has a fixed cost."""
        if self.rt.device == "cpu":
            return self.room
        return min(max(VIEW_EACH * rays, self.room), VIEW_ROOM)

    def _room_to_view(self, room: int) -> Viewing:
        """Use the room of training for rendering if it is large enough; else allocate more."""
        counts = self.rt.zeros((2,), np.int32)
        if room <= self.room:
            return Viewing(self.samples.first(room), counts)
        return Viewing(self._room_for(room, counts[:1]), counts)

    def _see(self, viewing: Viewing, origins: Any, directions: Any, seen: View) -> None:
        """Composite the next samples of all rays, until each is opaque or has left the field."""
        rt, view, living = self.rt, self.rt.radiance.rendering, origins.shape[0]
        at = rt.scratch("view.at", (living,))
        taken, listing, going = (
            rt.scratch(f"view.{name}", (living,), np.int32) for name in ("taken", "list", "going")
        )
        spans = rt.scratch("view.spans", (living, 2), np.int32)
        counts = viewing.counts
        # All rays are active and none is jittered, so the counts passed here are not read.
        rays, march = Rays(origins, directions, counts), self._march(False, counts)
        views = Views(at, taken, *seen)
        view.set_out(rays, self.space, march, listing, counts, views)
        # A round takes a sample of each living ray at least, and a ray has `most` at most.
        while living:
            s = viewing.samples
            few = min(viewing.room // living, VIEW_FEW)
            found = codes.Samples(s.positions, s.distances, s.rays)
            view.march_on(
                rays, self.space, march, few, living, listing, views, going, spans, counts, found
            )
            total, living = map(int, rt.to_numpy(counts))
            if living:
                s = viewing.first(total)
                self.evaluate(directions, s)
                view.composite_on(
                    s.sigma, s.rgb, s.distances, going, spans, living, STOP, counts, views
                )
                listing, going = going, listing

    def _march(self, jittered: bool, step: Any) -> March:
        frame = self.frame
        return March(
            frame.near, frame.far, self.finest, self.cone, STEPS, jittered, self.seed, step
        )

    def forward(self, rays: Rays, step: Any) -> Composited:
        """See :meth:`Field.forward`."""
        s = self.samples
        found = codes.Samples(s.positions, s.distances, s.rays)
        self.rt.radiance.march.steps.march_rays(
            self.space, self._march(True, step), rays, self.spans, s.total, found
        )
        self.evaluate(rays.directions if self._sides is None else self._sides, s)
        self.rt.radiance.compositing.forward(
            s.sigma, s.rgb, s.distances, self.spans, STOP, self.rendered
        )
        return self.rendered

    def backward(self, gradients: Composited) -> None:
        """See :meth:`Field.backward`."""
        s = self.samples
        self.rt.radiance.compositing.backward(
            gradients, s.sigma, s.rgb, s.distances, self.spans, STOP, self.d_sigma, self.d_rgb
        )
        self.evaluate_backward()

    def look_aside(self, aside: bool) -> None:
        """See :meth:`Field.look_aside`: the colour network is given any directions."""
        if aside == (self._sides is not None):
            return
        self.edition += 1
        self._sides = None
        if aside:
            sides = np.random.default_rng(self.seed).normal(size=(self.rays, 3))
            sides /= np.linalg.norm(sides, axis=1, keepdims=True)
            self._sides = self.rt.zeros(sides.shape)
            self.rt.write(self._sides, sides.astype(np.float32))

    def taken(self) -> int:
        """See :meth:`Field.taken`."""
        return int(self.rt.to_numpy(self.samples.total)[0])

    def densities(self, points: np.ndarray) -> np.ndarray:
        """See :meth:`Field.densities`."""
        places = np.asarray(points, np.float32)
        if self.frame.bounds.unbounded:
            size = np.maximum(np.linalg.norm(places, axis=1, keepdims=True), 1.0)
            places = places * ((2 - 1 / size) / size) / 2
        places = 0.5 * places + 0.5
        found = np.empty(len(places), np.float32)
        block = np.zeros((self.room, 3), np.float32)
        for begin in range(0, len(places), self.room):
            part = places[begin : begin + self.room]
            block[: len(part)] = part
            self.rt.write(self.samples.positions, block)
            self.evaluate_density(self._all)
            found[begin : begin + len(part)] = self.rt.to_numpy(self.samples.sigma)[: len(part)]
        return found

    def rays_for(self, samples: int, rays: int) -> int:
        """See :meth:`Field.rays_for`."""
        return max(1, min(self.rays, int(rays * FILL * self.room / max(samples, 1))))

    def tend(self, step: int, learning: Learning) -> None:
        """Update the occupancy grid periodically."""
        if step % EVERY == 0:
            everywhere = step < SETTLED
            if everywhere not in self._updates:
                self._update_occupancy(everywhere, learning.step)
                self._updates[everywhere] = self.rt.record(
                    lambda: self._update_occupancy(everywhere, learning.step)
                )
            else:
                self._updates[everywhere]()

    def rest(self) -> None:
        """See :meth:`Field.rest`."""
        self._updates.clear()

    def _update_occupancy(self, everywhere: bool, step: Any) -> None:
        """Raise cells to the density at a random point in them: all cells, or a random part."""
        occupancy, count = self.rt.radiance.march.occupancy, self.levels * self.cells**3
        occupancy.fade(FADE, self.density)
        for begin in range(0, count if everywhere else -(-count // 4), self.room):
            occupancy.visit(
                self.cells, count, everywhere, self.frame.bounds.unbounded, self.seed, step, begin,
                self._visited, self.samples.positions,
            )  # fmt: skip
            self.evaluate_density(self._all)
            occupancy.raise_to(self._visited, self.samples.sigma, self.density)
        least = OPTICAL_THICKNESS / self.finest
        occupancy.mark(self.density, least, self._parts, self._limit, self.bits)

    def state(self) -> dict[str, np.ndarray]:
        """See :meth:`Field.state`."""
        return {"occupancy.density": self.rt.to_numpy(self.density).copy(),
                "occupancy.bits": self.rt.to_numpy(self.bits).copy()}  # fmt: skip

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """See :meth:`Field.restore`."""
        self.rt.write(self.density, taken(state, "occupancy.density", self.density.shape))
        self.rt.write(self.bits, taken(state, "occupancy.bits", self.bits.shape, np.uint32))


def check_batch(settings: Any) -> None:
    """Check the settings that all such fields have."""
    check_integer(settings.steps, "steps", 1, STEPS)
    check_integer(settings.samples, "samples", settings.steps, 2**24)  # room for a ray
    check_integer(settings.rays, "rays", 1, 2**24)
    if check_integer(settings.cells, "cells", 8, 512) % 8:
        raise ValueError(f"cells must be a multiple of 8, got {settings.cells}")
    for name in ("learning_rate", "final_rate"):
        check_positive(getattr(settings, name), name)
    check_number(settings.weight_decay, "weight_decay", low=0.0)
    if settings.gradient_clip is not None:
        check_positive(settings.gradient_clip, "gradient_clip")


def check_occupancy(settings: Any, state: Mapping[str, np.ndarray], frame: Frame) -> None:
    """Refuse a state with another occupancy grid, before memory for it is allocated."""
    count = (LEVELS if frame.bounds.unbounded else 1) * settings.cells**3
    check_shapes(state, {"occupancy.density": (count,), "occupancy.bits": (count // 32,)})


def check_shapes(state: Mapping[str, np.ndarray], shapes: dict[str, tuple[int, ...]]) -> None:
    """Refuse a state without arrays of these shapes; none is read."""
    for name, shape in shapes.items():
        if name not in state:
            raise ValueError(f"state must have {name!r}, got {tuple(state)}")
        if shape_of(state, name) != shape:
            raise ValueError(f"{name} must have shape {shape}, got {shape_of(state, name)}")


def taken(
    state: Mapping[str, np.ndarray], name: str, shape: tuple[int, ...], dtype: Any = np.float32
) -> np.ndarray:
    """Return an array of a state; check its name, shape and dtype before it is used.

    Files for rendering only have floats in half precision.
    """
    check_shapes(state, {name: tuple(shape)})
    found = state[name]
    if found.dtype == np.float16 and dtype == np.float32:
        return found.astype(np.float32)
    if found.dtype != dtype:
        raise ValueError(f"{name} must be {np.dtype(dtype)}, got {found.dtype}")
    return found
