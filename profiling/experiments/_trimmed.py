"""Trimmed residuals of patches, the rule that `fit(robust=True)` is compared with.

RobustNeRF (Sabour et al., CVPR 2023) draws patches of pixels and trims those with large errors.
Here the mean errors of patches are remembered over batches instead, as `fit(robust=True)` remembers
shares. A patch whose error, averaged over neighbours, is above a quantile of all has no part.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter

from cvkern._runtime import Runtime
from cvkern.radiance.wild.distractors import EVERY, Distractors

KEPT = 0.85  # share of the patches that is kept
FADE = 0.9  # what remains of the sums at each update
LEAST = 1e-4  # share of patches that are left out
FLAT = 1 / (2 * math.pi)  # variance with which errors hardly matter beside shares


class Trimmed(Distractors):
    """Patches with weights of nearly 0 or 1, by their mean errors."""

    def __init__(self, rt: Runtime, shape: tuple[int, ...], rays: int):
        super().__init__(rt, shape, rays)
        self._width, self._last = shape[2], None
        self._error, self._count = np.zeros((2, *self.patches.share.shape))
        rt.write(self.patches.noise, np.array([FLAT], np.float32))

    def weigh(
        self, errors: Any, places: tuple[Any, Any], active: Any, gradients: tuple[Any, Any, Any]
    ) -> None:
        """See :meth:`Distractors.weigh`."""
        self.rt.radiance.wild.distractors.weigh(
            errors, *places, active, self.patches, *gradients, self._moments
        )
        self._last = errors, *places, active

    def tend(self, step: int) -> None:
        """See :meth:`Distractors.tend`."""
        if step % EVERY or self._last is None:
            return
        errors, views, pixels, active = map(self.rt.to_numpy, self._last)
        few = slice(int(active[0]))
        row, column = np.divmod(pixels[few], self._width)
        at = views[few], row // self.patches.side, column // self.patches.side
        self._error *= FADE
        self._count *= FADE
        np.add.at(self._error, at, errors[few])
        np.add.at(self._count, at, 1.0)
        error, count = (uniform_filter(a, (1, 3, 3)) for a in (self._error, self._count))
        mean = error / np.maximum(count, 1e-6)
        kept = mean <= np.quantile(mean, KEPT)
        share = np.where(kept, 1 - LEAST, LEAST).astype(np.float32)
        self.rt.write(self.patches.share, share)
