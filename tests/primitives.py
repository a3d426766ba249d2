"""The primitives of a kernel set, called with NumPy arrays wherever they run, and such arrays."""

import importlib

import numpy as np
import pytest
import scipy.ndimage as ndi

F32, I32, U8, U16, U64 = np.float32, np.int32, np.uint8, np.uint16, np.uint64


class Guarded:
    """A copy of an array between canaries: bits that are NaN, and 255 or -1 where they are read."""

    SIZE = 512  # bytes on either side
    ALIGNED = 64

    def __init__(self, array):
        array = np.ascontiguousarray(array)
        self._memory = np.full(array.nbytes + 2 * self.SIZE + self.ALIGNED, 255, np.uint8)
        self._begin = self.SIZE + -(self._memory.ctypes.data + self.SIZE) % self.ALIGNED
        self._end = self._begin + array.nbytes
        inside = self._memory[self._begin : self._end]
        self.array = inside.view(array.dtype).reshape(array.shape)
        self.array[...] = array

    def is_whole(self):
        """Tell whether nobody has written beside the array."""
        return bool(
            (self._memory[: self._begin] == 255).all() and (self._memory[self._end :] == 255).all()
        )


class Primitives:
    """The primitives of one kernel set on one device, from NumPy to NumPy."""

    def __init__(self, name, device):
        self.name, self.device = name, device
        self._package = importlib.import_module(f"cvkern.kernels.{name}")
        try:
            self.start()
        except ValueError as absent:
            pytest.skip(str(absent))

    def start(self):
        self._package.start(self.device, None)

    def __call__(self, primitive, *arguments, out):
        """Call "FAMILY.MODULE.NAME" with inputs, then with outputs.

        An output is the (shape, dtype) of an array of nothing useful, or an array to begin with, or
        None.
        Named tuples of inputs and of outputs are handed over as such.
        """
        module, _, name = primitive.rpartition(".")
        function = getattr(importlib.import_module(f"{self._package.__name__}.{module}"), name)
        self.start()
        results, guards, carried = [], [], []

        def begin(output):
            if output is None:
                return None
            before = output if isinstance(output, np.ndarray) else np.full(output[0], 77, output[1])
            guards.append(Guarded(before))
            results.append(guards[-1].array)
            carried.append(self._adopt(results[-1]))
            return carried[-1]

        outputs = [within(begin, output) for output in out]
        function(*(within(self._given, a) for a in arguments), *outputs)
        for guard in guards:
            assert guard.is_whole(), f"{primitive} wrote beyond an output"
        if self.device != "cpu":
            results = [self._package.to_numpy(c) for c in carried]
        return results if len(results) > 1 else results[0]

    def _given(self, value):
        return self._adopt(Guarded(value).array) if isinstance(value, np.ndarray) else value

    def _adopt(self, array):
        array = np.ascontiguousarray(array)
        return self._package.adopt(array, array.dtype, array.shape, self.device)


def within(change, value):
    """Change a value, or each field of a named tuple."""
    return type(value)(*map(change, value)) if hasattr(value, "_fields") else change(value)


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
