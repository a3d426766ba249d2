"""What passes in front of a scene: weights of rays by how likely they are to show the scene."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import Patches
from cvkern.radiance.march import taken

SIDE, MOST_SIDES = 4, 128  # least side of a patch, pixels; most patches along a photograph
EVERY = 16  # steps between updates of the patches
START, WEIGHT = 0.999, 1.0  # share of a patch before its rays are counted, and its weight in rays
REMEMBERED = 64  # rays of a patch above which their number is halved, to forget the early ones
# Mean squared error of the scene's own colours: at first, its least value, and its rate of change.
NOISE, LEAST_NOISE, RATE = 0.03, 0.01, 0.02
PARTS = 256  # partial sums of the errors of a batch
DISTRACTORS = "distractors."  # begins the names of their arrays


def patches_of(height: int, width: int) -> tuple[int, int, int]:
    """Return the side of the patches of a photograph, and their numbers of rows and columns."""
    side = max(SIDE, -(-max(height, width) // MOST_SIDES))
    return side, -(-height // side), -(-width // side)


class Distractors:
    """The patches of the training photographs, being learnt."""

    def __init__(self, rt: Runtime, shape: tuple[int, ...], rays: int):
        """Begin for photographs of the shape (N, H, W)."""
        self.rt = rt
        images, height, width = shape
        side, rows, columns = patches_of(height, width)
        each = images, rows, columns
        sums, counts = rt.zeros(each, np.int32), rt.zeros(each, np.int32)
        self.patches = Patches(rt.zeros(each), sums, counts, rt.zeros((1,)), width, side)
        rt.write(self.patches.share, np.full(each, START, np.float32))
        rt.write(self.patches.noise, np.array([NOISE], np.float32))
        self._moments, self._parts = rt.zeros((rays, 3)), rt.zeros((PARTS, 3))
        self._totals = rt.zeros((3,))

    def weigh(
        self, errors: Any, places: tuple[Any, Any], active: Any, gradients: tuple[Any, Any, Any]
    ) -> None:
        """Multiply gradients, of colours, opacities and backgrounds, by the weights of the rays.

        `places` are the photographs and the pixels of the rays.
        """
        kernels = self.rt.radiance.wild.distractors
        kernels.weigh(errors, *places, active, self.patches, *gradients, self._moments)
        self.rt.radiance.training.background.gather(
            self._moments, active, self._parts, self._totals
        )
        kernels.learn_noise(self._totals, RATE, LEAST_NOISE, self.patches.noise)

    def tend(self, step: int) -> None:
        """Update the patches periodically."""
        if step % EVERY == 0:
            self.rt.radiance.wild.distractors.settle(self.patches, START, WEIGHT, REMEMBERED)

    def state(self) -> dict[str, np.ndarray]:
        """Return the arrays to save."""
        arrays = self.patches._asdict()
        return {DISTRACTORS + k: self.rt.to_numpy(arrays[k]).copy() for k in Patches._fields[:4]}

    def restore(self, extra: dict[str, np.ndarray]) -> None:
        """Restore the saved arrays."""
        for name in Patches._fields[:4]:
            array = getattr(self.patches, name)
            dtype = np.int32 if name in ("sums", "counts") else np.float32
            self.rt.write(array, taken(extra, DISTRACTORS + name, array.shape, dtype))
