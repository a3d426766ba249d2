"""The primitives of a kernel set, called with NumPy arrays wherever they run, and such arrays."""

import importlib

import numpy as np
import pytest
import scipy.ndimage as ndi

F32, I32, U8, U16, U64 = np.float32, np.int32, np.uint8, np.uint16, np.uint64


class Primitives:
    """The primitives of one kernel set on one device, from NumPy to NumPy."""

    def __init__(self, name, device):
        self.name, self.device = name, device
        pytest.importorskip(name)
        self._package = importlib.import_module(f"cvkern.kernels.{name}")
        try:
            self.start()
        except ValueError as absent:
            pytest.skip(str(absent))

    def start(self):
        self._package.start(self.device, None)

    def __call__(self, primitive, *arguments, out):
        """Call "FAMILY.MODULE.NAME" with inputs, then with outputs.

        An output is the (shape, dtype) of an array of nothing useful, or an array to begin with.
        """
        module, _, name = primitive.rpartition(".")
        function = getattr(importlib.import_module(f"{self._package.__name__}.{module}"), name)
        self.start()
        inputs = [self._input(a) for a in arguments]
        results = [o.copy() if isinstance(o, np.ndarray) else np.full(o[0], 77, o[1]) for o in out]
        carried = [self._adopt(r) for r in results]
        function(*inputs, *carried)
        if self.device != "cpu":
            results = [self._package.to_numpy(c) for c in carried]
        return results if len(results) > 1 else results[0]

    def _input(self, argument):
        if isinstance(argument, np.ndarray):
            return self._adopt(argument)
        if isinstance(argument, tuple):  # a named tuple
            return type(argument)(*map(self._input, argument))
        return argument

    def _adopt(self, array):
        array = np.ascontiguousarray(array)
        return self._package.adopt(array, array.dtype, array.shape, self.device)


def noise(*shape, seed=0):
    """Return normal numbers."""
    return np.random.default_rng(seed).normal(size=shape).astype(F32)


def waves(height, width, seed=0):
    """Return smooth gradients in every direction, with flat parts and ties."""
    values = ndi.gaussian_filter(noise(height, width, seed=seed).astype(float), 2.0) * 50
    values[: height // 4] = 0
    values[:, : width // 5] = np.round(values[:, : width // 5])
    dy, dx = np.gradient(values) if min(values.shape) > 1 else (values, -values)
    return np.asarray(dy, F32), np.asarray(dx, F32)
