"""What every radiance field does: render rays, take gradients back, learn, be saved.

Inside a field, lengths are in units of half the side of the scene's cube, whose middle is the
origin: a :class:`Frame` says how the world lies in it.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import Rays, Seen
from cvkern.radiance.scenes.photographs import Bounds, Scene

FARTHEST = 2**15  # from the middle: there, float32 still tells the steps along a ray apart


@dataclass(frozen=True)
class Frame:
    """The region that rays are marched through."""

    bounds: Bounds
    near: float
    """Distance before which there is nothing, in units of half the cube's side."""
    far: float
    """Distance behind which there is nothing, in the same units; large if there is no end."""
    pixel: float = 0.01
    """Side of what a pixel of the photographs sees at the middle of the cube, in the same units."""

    @classmethod
    def of(cls, scene: Scene) -> Frame:
        """Return the frame of a scene."""
        half = scene.bounds.half
        pixel = scene.footprint / half
        far = min(scene.far / half, 2.0 * FARTHEST)  # behind the cube, seen from anywhere
        return cls(scene.bounds, scene.near / half, far, pixel)

    def inside(self, poses: np.ndarray) -> np.ndarray:
        """Return poses, camera to world, (N, 3, 4), as float32 poses of this frame.

        Raises
        ------
        ValueError
            If a camera is too far away.
        """
        moved = poses.copy()
        moved[:, :, 3] = (poses[:, :, 3] - np.array(self.bounds.center)) / self.bounds.half
        farthest = np.linalg.norm(moved[:, :, 3], axis=1).max(initial=0.0)
        if not farthest <= FARTHEST:
            raise ValueError(
                f"cameras must be within {FARTHEST} half-sides of the scene's cube from its "
                f"middle, got one at {farthest:g}"
            )
        return moved.astype(np.float32)


class View(NamedTuple):
    """What the rays of a view see before any background; kernel arrays."""

    color: Any
    """(R, 3) float32."""
    opacity: Any
    """(R,) float32."""
    depth: Any
    """Sum of the distances of the samples, each by its weight, (R,) float32."""


class Learning(NamedTuple):
    """What an optimizer step needs, on the device."""

    step: Any
    """Number of the step, (1,) int32."""
    progress: Any
    """Share of the training that is done, (1,) float32."""
    scale: float
    """What gradients of the losses have to be multiplied by, beside 1 / `Field.gradient_scale`."""


class Field(abc.ABC):
    """A radiance field on one device, being trained or used."""

    rt: Runtime
    frame: Frame
    rays: int
    """How many rays a batch of training has room for."""
    first_rays: int
    """How many of them the first batch should have, before any is counted."""
    edition: int = 0
    """Counted up when arrays are replaced: what was recorded with the old ones is void."""
    gradient_scale: float = 1.0
    """What losses are multiplied by before :meth:`backward`, so that numbers of few bits, half
    precision's or fixed-point ones, can hold their gradients; :meth:`learn` divides by it."""

    @abc.abstractmethod
    def see(self, origins: Any, directions: Any, seen: View) -> None:
        """Fill `seen` with what rays see: origins and unit directions (R, 3), for any R."""

    @abc.abstractmethod
    def forward(self, rays: Rays, step: Any) -> Seen:
        """Render rays in training; `step` (1,) int32 draws the places of the samples."""

    @abc.abstractmethod
    def backward(self, gradients: Seen) -> None:
        """Add the gradients of what :meth:`forward` last returned to those of the parameters."""

    @abc.abstractmethod
    def learn(self, learning: Learning) -> None:
        """Move the parameters by their gradients, and forget those."""

    def make_deterministic(self) -> None:  # noqa: B027  (may be so anyway)
        """Make gradients that are equal from run to run, from now on."""

    @abc.abstractmethod
    def taken(self) -> int:
        """Return how many samples :meth:`forward` last took; waits for the device."""

    @abc.abstractmethod
    def densities(self, points: np.ndarray) -> np.ndarray:
        """Return the density at points (N, 3) of the frame, per unit of its length, (N,)."""

    @abc.abstractmethod
    def rays_for(self, samples: int, rays: int) -> int:
        """Return how many rays fill a batch, after so many took so many samples."""

    def tend(self, step: int, learning: Learning) -> None:  # noqa: B027  (may be nothing)
        """Do what is due now and then, before step `step`: look where space is empty, refine."""

    def rest(self) -> None:  # noqa: B027  (may be nothing)
        """Forget the `learning` of :meth:`tend`: this training is over."""

    @abc.abstractmethod
    def state(self) -> dict[str, np.ndarray]:
        """Return everything that is needed to go on, by name.

        Names that end in ``.mean`` or ``.square`` are the optimizer's.
        """

    def to_render(self, state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return a state that renders the same, with zeros, which files hold for nothing."""
        needless = ".mean", ".square"
        return {k: np.zeros_like(a) if k.endswith(needless) else a for k, a in state.items()}

    @abc.abstractmethod
    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take up what :meth:`state` gave.

        Raises
        ------
        ValueError
            If an array is missing or has the wrong shape.
        """
