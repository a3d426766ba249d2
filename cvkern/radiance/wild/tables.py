"""Numbers of each photograph that are learnt with the field."""

from __future__ import annotations

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import AdamRule
from cvkern.radiance.fields.field import Learning
from cvkern.radiance.fields.parameters import Clip, Parameters


class Table:
    """The numbers of the training photographs, being learnt."""

    prefix: str  # begins the names of the arrays
    rates: tuple[float, int, float]  # learning rate, steps until it is full, share at the end
    rule: AdamRule

    def __init__(self, rt: Runtime, values: np.ndarray):
        self.rt = rt
        self.table = Parameters(rt, values, np.dtype(np.float32))
        self._rate, self._clip = rt.zeros((3,)), Clip(rt, None)

    def learn(self, learning: Learning, scale: float) -> None:
        """Update the numbers; `scale` is that of the gradients."""
        adam, rule = self.rt.radiance.training.adam, self.rule
        adam.learning_rate(
            learning.step, learning.progress, *self.rates, rule.beta1, rule.beta2, self._rate
        )
        self._clip.update(scale)
        adam.adam(self._rate, self._clip.factor, rule, *self.table.flat())

    def state(self) -> dict[str, np.ndarray]:
        """Return the arrays to save."""
        return self.table.state(self.prefix, self.rt)

    def restore(self, extra: dict[str, np.ndarray]) -> None:
        """Restore the saved arrays."""
        self.table.restore(self.prefix, extra, self.rt)
