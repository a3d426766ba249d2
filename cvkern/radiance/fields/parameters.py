"""The parameters of a field, and the scale of their gradients."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import Learnt
from cvkern.radiance.march import taken

LIFT = 128.0  # `Field.gradient_scale` if float16 or fixed-point numbers hold gradients
PARTS = 1024  # partial sums of a sum of squares


class Parameters:
    """Parameters with Adam's moments, and a copy in the precision of the kernels."""

    def __init__(self, rt: Runtime, values: np.ndarray, dtype: Any):
        shape = values.shape
        self.values, self.gradients, self.mean, self.square = (rt.zeros(shape) for _ in range(4))
        self.sums = self.gradients
        self.copy = self.values if dtype == np.float32 else rt.zeros(shape, dtype)
        self._write(values, rt)

    def _write(self, values: np.ndarray, rt: Runtime) -> None:
        rt.write(self.values, values.astype(np.float32))
        if self.copy is not self.values:
            rt.write(self.copy, values.astype(np.float16))

    def make_deterministic(self, rt: Runtime) -> None:
        """Collect gradients as `sums` of fixed-point numbers, which do not depend on the order."""
        self.sums = rt.zeros(self.values.shape, np.int64)

    def collect(self, rt: Runtime) -> None:
        """Convert the `sums` of a backward pass to gradients."""
        if self.sums is not self.gradients:
            rt.radiance.training.adam.collect(flat(self.sums), flat(self.gradients))

    def flat(self) -> tuple[Learnt, Any]:
        """Return the arrays that Adam updates, and the copy that it fills."""
        learnt = self.gradients, self.mean, self.square, self.values
        return Learnt(*map(flat, learnt)), flat(self.copy)

    def state(self, prefix: str, rt: Runtime) -> dict[str, np.ndarray]:
        """Return the arrays to save."""
        arrays = {"values": self.values, "mean": self.mean, "square": self.square}
        return {prefix + name: rt.to_numpy(a).copy() for name, a in arrays.items()}

    def restore(self, prefix: str, state: Mapping[str, np.ndarray], rt: Runtime) -> None:
        """Restore the saved arrays."""
        self._write(taken(state, prefix + "values", self.values.shape), rt)
        rt.write(self.mean, taken(state, prefix + "mean", self.mean.shape))
        rt.write(self.square, taken(state, prefix + "square", self.square.shape))


class Clip:
    """The factor of the gradients: a scale, or less if their norm would be too large."""

    def __init__(self, rt: Runtime, most: float | None):
        self.rt, self.most = rt, most
        self.factor, self.parts = rt.zeros((1,)), rt.zeros((PARTS,))

    def update(self, scale: float, *gradients: Any) -> None:
        """Compute `factor` (1,) for these gradients; the bound is on the norm after scaling."""
        adam, most = self.rt.radiance.training.adam, math.inf
        if self.most is not None:
            most = self.most
            for array in gradients:
                adam.add_squares(flat(array), self.parts)
        adam.clip(scale, most, self.parts, self.factor)


def flat(array: Any) -> Any:
    """View an array as 1-D."""
    return array.reshape((-1,)) if len(array.shape) > 1 else array
