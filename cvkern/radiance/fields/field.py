"""The interface of all radiance fields: render rays, propagate gradients back, learn, be saved.

Inside a field, lengths are in units of half the side of the scene's cube, and the middle of the
cube is the origin. A :class:`Frame` maps the world to these coordinates.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import CameraSet, Composited, Lights, Rays
from cvkern.radiance.scenes.photographs import Bounds, Scene

FARTHEST = 2**15  # distance from the middle up to which float32 resolves the steps along a ray


@dataclass(frozen=True)
class Frame:
    """The region that rays are marched through."""

    bounds: Bounds
    near: float
    """Distance from a camera at which rays begin, in units of half the cube's side."""
    far: float
    """Distance from a camera at which rays end, in the same units; large if there is no end."""
    pixel: float = 0.01
    """Side of a photograph's pixel at the distance of the cube's middle, in the same units."""

    @classmethod
    def of(cls, scene: Scene) -> Frame:
        """Return the frame of a scene."""
        half = scene.bounds.half
        pixel = scene.footprint / half
        far = min(scene.far / half, 2.0 * FARTHEST)  # beyond the cube, seen from any camera
        return cls(scene.bounds, scene.near / half, far, pixel)

    def inside(self, poses: np.ndarray) -> np.ndarray:
        """Convert camera-to-world poses (N, 3, 4) to float32 poses of this frame.

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
    """The composited rays of a view, without a background; kernel arrays."""

    color: Any
    """(R, 3) float32."""
    opacity: Any
    """(R,) float32."""
    depth: Any
    """Weighted sum of the distances of the samples, (R,) float32."""


class Learning(NamedTuple):
    """The inputs of an optimizer step, on the device."""

    step: Any
    """Number of the step, (1,) int32."""
    progress: Any
    """Share of the training that is done, (1,) float32."""
    scale: float
    """Factor of the gradients of the losses, in addition to 1 / `Field.gradient_scale`."""


class Field(abc.ABC):
    """A radiance field on one device, being trained or used."""

    rt: Runtime
    frame: Frame
    rays: int
    """Largest number of rays of a training batch."""
    first_rays: int
    """Number of rays of the first batch, before samples have been counted."""
    whole: bool = False
    """Whether it renders whole views: batches are all pixels of a photograph, see
    :meth:`photograph`, and pictures are made by :meth:`draw` and not by :meth:`see`."""
    can_look_aside: bool = False
    """Whether :meth:`look_aside` has an effect."""
    edition: int = 0
    """Increases when arrays are replaced, which invalidates recordings made with the old ones."""
    gradient_scale: float = 1.0
    """Factor of the losses before :meth:`backward`, so that half precision or fixed point can hold
    their gradients; :meth:`learn` divides by it."""

    def start(self, scene: Scene, options: Mapping[str, Any]) -> None:  # noqa: B027  (optional)
        """Begin from the photographs, instead of from anything: called once for a new model.

        `options` are those of :func:`fit` about backgrounds, lights, and what passes.

        Raises
        ------
        ValueError
            If the field cannot show this scene.
        """

    def begin(self, views: CameraSet) -> None:  # noqa: B027  (optional)
        """Get ready to be trained on photographs of these cameras."""

    def photograph(self, images: Any, seed: int, step: Any, targets: Any, places: Any) -> None:
        """Choose the photograph of a step, and fill `targets` (R, 4) and `places` of its pixels.

        Only fields that are `whole` do so.
        """
        raise NotImplementedError

    def leave_out(self, masks: Any, errors: Any, gradients: tuple[Any, Any, Any]) -> None:
        """Clear gradients where the mask (N R,) uint8 of the chosen photograph is 0.

        There, the errors become -1. Only fields that are `whole` do so.
        """
        raise NotImplementedError

    def draw(self, cameras: CameraSet, seen: View) -> None:
        """Fill `seen` for all pixels of the first of these cameras, if the field is `whole`."""
        raise NotImplementedError

    @abc.abstractmethod
    def see(self, origins: Any, directions: Any, seen: View, row: int = 0) -> None:
        """Fill `seen` for rays with these origins and unit directions, (R, 3), for any R.

        `row` is the width of a picture if these are the rays of its pixels, row by row, or 0.
        """

    @abc.abstractmethod
    def forward(self, rays: Rays, step: Any) -> Composited:
        """Render rays in training; `step` (1,) int32 seeds the random positions of the samples."""

    @abc.abstractmethod
    def backward(self, gradients: Composited) -> None:
        """Add to the parameters' gradients, given those of the last result of :meth:`forward`."""

    @abc.abstractmethod
    def collected(self) -> list[Any]:
        """Return the arrays that :meth:`backward` adds to, as :meth:`learn` takes them.

        Training on several devices adds them up; of bytes, which are marks, it keeps the largest.
        """

    @abc.abstractmethod
    def learn(self, learning: Learning) -> None:
        """Update the parameters by their gradients, and reset the gradients."""

    def make_deterministic(self) -> None:  # noqa: B027  (some fields always are)
        """From now on, compute gradients that are equal from run to run."""

    def look_aside(self, aside: bool) -> None:  # noqa: B027  (some colours never depend on it)
        """While `aside`, learn colours that are the same from all sides."""

    def light(self, lights: Lights) -> None:  # noqa: B027  (most fields have one light)
        """From now on, see the scene in these lights of rays, if the field was built `lit`."""

    @abc.abstractmethod
    def taken(self) -> int:
        """Return the number of samples of the last :meth:`forward`; wait for the device."""

    @abc.abstractmethod
    def densities(self, points: np.ndarray) -> np.ndarray:
        """Return the density (N,) at points (N, 3) of the frame, per unit of its length."""

    @abc.abstractmethod
    def rays_for(self, samples: int, rays: int) -> int:
        """Return how many rays fill a batch, if `rays` rays took `samples` samples."""

    def tend(self, step: int, learning: Learning) -> None:  # noqa: B027  (optional)
        """Do the periodic work before step `step`: update the empty space, refine."""

    def rest(self) -> None:  # noqa: B027  (optional)
        """Release the `learning` of :meth:`tend` when the training is over."""

    @abc.abstractmethod
    def state(self) -> dict[str, np.ndarray]:
        """Return all arrays that are needed to continue, by name.

        Names that end in ``.mean`` or ``.square`` belong to the optimizer.
        """

    def to_render(self, state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return a state to render: zeros where pictures need nothing, and half precision.

        Files compress zeros away.
        """
        needless = ".mean", ".square", "occupancy.density"
        return {
            k: np.zeros_like(a) if k.endswith(needless) else halved(a) for k, a in state.items()
        }

    @abc.abstractmethod
    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Restore the arrays that :meth:`state` returned.

        Raises
        ------
        ValueError
            If an array is missing or has the wrong shape.
        """


def halved(values: np.ndarray) -> np.ndarray:
    """Return floats in half precision, those too large as the largest; others as they are."""
    if values.dtype != np.float32:
        return values
    most = np.finfo(np.float16).max
    return values.clip(-most, most).astype(np.float16)
