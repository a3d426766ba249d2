"""The numbers that a field learns."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._runtime import Runtime
from cvkern.radiance.sampled import taken


class Parameters:
    """Parameters with what Adam keeps for them, and a copy in the precision they are used in."""

    def __init__(self, rt: Runtime, values: np.ndarray, dtype: Any):
        shape = values.shape
        self.values, self.gradients, self.mean, self.square = (rt.zeros(shape) for _ in range(4))
        self.copy = self.values if dtype == np.float32 else rt.zeros(shape, dtype)
        self._write(values, rt)

    def _write(self, values: np.ndarray, rt: Runtime) -> None:
        rt.write(self.values, values.astype(np.float32))
        if self.copy is not self.values:
            rt.write(self.copy, values.astype(np.float16))

    def flat(self) -> list[Any]:
        """Return gradients, means, squares, values and copy, as Adam takes them."""
        arrays = (self.gradients, self.mean, self.square, self.values, self.copy)
        return [a.reshape((-1,)) if len(a.shape) > 1 else a for a in arrays]

    def state(self, prefix: str, rt: Runtime) -> dict[str, np.ndarray]:
        """Return what has to be saved."""
        arrays = {"values": self.values, "mean": self.mean, "square": self.square}
        return {prefix + name: rt.to_numpy(a).copy() for name, a in arrays.items()}

    def restore(self, prefix: str, state: dict[str, np.ndarray], rt: Runtime) -> None:
        """Take up what was saved."""
        self._write(taken(state, prefix + "values", self.values.shape), rt)
        rt.write(self.mean, taken(state, prefix + "mean", self.mean.shape))
        rt.write(self.square, taken(state, prefix + "square", self.square.shape))
