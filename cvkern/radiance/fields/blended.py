"""Planes of several reference cameras, blended to one picture: local light field fusion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cvkern._archives import Stored
from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import Composited, Rays, Seen
from cvkern.radiance.fields.field import Field, Frame, Learning, View
from cvkern.radiance.fields.planes import PlanesField, PlaneStack
from cvkern.radiance.scenes.photographs import Scene

FEWEST = 4  # photographs from which the planes of a reference camera begin, if there are so many
ROUNDS = 20  # most rounds of k-means
SHARPEST = 1e6  # largest sharpness, which float32 holds for all cameras of a frame


class BlendedStacks(Field):
    """A field of a :class:`PlanesField` with several reference cameras."""

    def __init__(self, rt: Runtime, frame: Frame, settings: PlanesField):
        self.rt, self.frame, self.settings = rt, frame, settings
        self.rays = self.first_rays = rays = settings.rays
        count = settings.references
        own = replace(settings, references=1, texels=settings.texels // count)
        self.stacks = [PlaneStack(rt, frame, own) for _ in range(count)]
        self.rendered, self._parts, self._gradients = (
            Composited(rt.zeros((n, 3)), rt.zeros((n,)), rt.zeros((n,)), rt.zeros((1,)))
            for n in (rays, count * rays, count * rays)
        )
        for k, stack in enumerate(self.stacks):
            stack.rendered = _rows(self._parts, k, rays)
        self.eyes = rt.zeros((count, 4))

    def start(self, scene: Scene, options: Mapping[str, Any]) -> None:
        """See :meth:`Field.start`: a plane sweep of the photographs around each reference."""
        used = np.flatnonzero(~scene.test)
        eyes = self.frame.inside(scene.cameras.poses[used])[:, :, 3].astype(np.float64)
        for stack, near in zip(self.stacks, groups_of(eyes, len(self.stacks)), strict=True):
            chosen = used[near]
            stack.start(
                replace(
                    scene, images=scene.images[chosen], cameras=scene.cameras.select(chosen),
                    test=np.zeros(len(chosen), bool), depths=None, masks=None,
                ),
                options,
            )  # fmt: skip
        self._place()

    def _place(self) -> None:
        """Remember where the reference cameras are, and how fast their weights fall.

        A weight falls to 1 / e over the way on which the nearest plane moves by as many texels as
        there are planes, as in local light field fusion.
        """
        self.edition += 1
        rows = []
        for stack in self.stacks:
            pose, lens, disparities = stack.reference
            sharpness = lens[0] * disparities[0] / len(disparities)
            rows.append([*pose[:, 3], min(sharpness, SHARPEST)])
        self.rt.write(self.eyes, np.array(rows, np.float32))

    def make_deterministic(self) -> None:
        """See :meth:`Field.make_deterministic`."""
        for stack in self.stacks:
            stack.make_deterministic()
        self.gradient_scale = self.stacks[0].gradient_scale

    def see(self, origins: Any, directions: Any, seen: View, row: int = 0) -> None:
        """See :meth:`Field.see`."""
        rt, rays = self.rt, origins.shape[0]
        shapes = {"color": (3,), "opacity": (), "depth": ()}
        parts = Seen(*(
            rt.scratch(f"planes.{name}", (len(self.stacks) * rays, *tail))
            for name, tail in shapes.items()
        ))  # fmt: skip
        for k, stack in enumerate(self.stacks):
            stack.see(origins, directions, View(*_rows(parts, k, rays)), row)
        active = rt.constant(np.array([2**31 - 1], np.int32))
        rt.radiance.fields.planes.blending.blend(
            Rays(origins, directions, active), self.eyes, parts, Seen(*seen)
        )

    def forward(self, rays: Rays, step: Any) -> Composited:
        """See :meth:`Field.forward`; there is no distortion."""
        for stack in self.stacks:
            stack.forward(rays, step)
        self._last = rays, self.eyes, Seen(*self._parts[:3])
        self.rt.radiance.fields.planes.blending.blend(*self._last, Seen(*self.rendered[:3]))
        return self.rendered

    def backward(self, gradients: Composited) -> None:
        """See :meth:`Field.backward`."""
        self.rt.radiance.fields.planes.blending.blend_backward(
            Seen(*gradients[:3]), *self._last, Seen(*self.rendered[:3]), Seen(*self._gradients[:3])
        )
        for k, stack in enumerate(self.stacks):
            stack.backward(_rows(self._gradients, k, self.rays))

    def collected(self) -> list[Any]:
        """See :meth:`Field.collected`."""
        return [array for stack in self.stacks for array in stack.collected()]

    def learn(self, learning: Learning) -> None:
        """See :meth:`Field.learn`."""
        for stack in self.stacks:
            stack.learn(learning)

    def taken(self) -> int:
        """See :meth:`Field.taken`."""
        return sum(stack.taken() for stack in self.stacks)

    def rays_for(self, samples: int, rays: int) -> int:
        """See :meth:`Field.rays_for`; samples take no memory here, so the number is fixed."""
        return self.rays

    def densities(self, points: np.ndarray) -> np.ndarray:
        """See :meth:`Field.densities`; it is the largest one of the references' planes."""
        return np.max([stack.densities(points) for stack in self.stacks], axis=0)

    def state(self) -> dict[str, np.ndarray]:
        """See :meth:`Field.state`."""
        states = enumerate(stack.state() for stack in self.stacks)
        return {f"{k}.{name}": array for k, state in states for name, array in state.items()}

    def to_render(self, state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """See :meth:`Field.to_render`: texels of 8 bits, so pictures differ by their rounding."""
        kept = {}
        for k, stack in enumerate(self.stacks):
            small = stack.to_render(dict(_of(state, k)))
            kept |= {f"{k}.{name}": array for name, array in small.items()}
        return kept

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """See :meth:`Field.restore`."""
        for k, stack in enumerate(self.stacks):
            stack.restore(_of(state, k))
        self._place()


def _rows(arrays: Any, k: int, rays: int) -> Any:
    """Return the part of a tuple of arrays, of K R rows, that belongs to a reference camera."""
    part = slice(k * rays, (k + 1) * rays)
    rows = (a[part] for a in arrays[:3])
    return type(arrays)(*rows, *arrays[3:])


def _of(state: Mapping[str, np.ndarray], k: int) -> Mapping[str, np.ndarray]:
    """Return the arrays of a reference camera, without reading them where they are in a file."""
    if isinstance(state, Stored):
        return state.part(str(k))
    prefix = f"{k}."
    return {name.removeprefix(prefix): a for name, a in state.items() if name.startswith(prefix)}


def groups_of(eyes: np.ndarray, count: int) -> list[np.ndarray]:
    """Choose the photographs at `eyes` (N, 3) that each of `count` reference cameras begins with.

    They are those nearest to the middles that k-means finds, from photographs that are far apart.
    There are enough of them that every photograph could be in one group, and some are in several.

    Raises
    ------
    ValueError
        If there are fewer photographs than reference cameras.
    """
    if count > len(eyes):
        raise ValueError(
            f"references must be at most the number of photographs, got {count} and {len(eyes)}"
        )
    chosen = [int(np.linalg.norm(eyes - eyes.mean(axis=0), axis=1).argmax())]
    while len(chosen) < count:
        gaps = np.linalg.norm(eyes[:, None] - eyes[None, chosen], axis=2).min(axis=1)
        chosen.append(int(gaps.argmax()))
    middles = eyes[chosen]
    for _ in range(ROUNDS):
        nearest = np.linalg.norm(eyes[:, None] - middles[None], axis=2).argmin(axis=1)
        moved = np.array([
            eyes[nearest == k].mean(axis=0) if (nearest == k).any() else middle
            for k, middle in enumerate(middles)
        ])  # fmt: skip
        if np.array_equal(moved, middles):
            break
        middles = moved
    few = max(min(FEWEST, len(eyes)), math.ceil(len(eyes) / count))
    away = np.linalg.norm(eyes[:, None] - middles[None], axis=2)
    return [np.sort(np.argsort(away[:, k], kind="stable")[:few]) for k in range(count)]
