"""The same values as other kinds of objects: what callers may hold them in, or must not."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.fuzz.arguments import Draw


class Frame:
    """A table as pandas has them: NumPy can read it, and it is no array."""

    def __init__(self, values: np.ndarray):
        self._values = values
        self.shape = values.shape

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self._values, dtype)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return f"Frame{self.shape}"

    def __iter__(self) -> Any:  # the names of the columns
        return iter("abc")


class Once:
    """Values that can be iterated, and neither counted nor indexed."""

    def __init__(self, values: list[Any]):
        self.values = values

    def __iter__(self) -> Any:
        return iter(self.values)

    def __repr__(self) -> str:
        return f"Once of {len(self.values)}"


def disguised(draw: Draw, value: np.ndarray) -> Any:
    """Return an array as another kind of object that holds the same values, or as none can."""
    kind = draw.pick(["frame", "buffer", "order", "list", "masked", "locked", "apart", "matrix"])
    if kind == "frame":
        return Frame(value)
    if kind == "locked":
        value.setflags(write=False)
        return value
    if kind == "apart" and value.dtype.kind in "biufc":  # not at a multiple of its size
        store = np.zeros(value.nbytes + 1, np.uint8)[1:]
        store[:] = np.frombuffer(value.tobytes(), np.uint8)
        return store.view(value.dtype).reshape(value.shape)
    if kind == "matrix" and value.ndim == 2:  # its slices have two axes, and `*` is not by items
        return np.asmatrix(value)
    if kind == "buffer" and value.size and value.dtype.isnative:
        return memoryview(np.ascontiguousarray(value))  # pyright: ignore[reportArgumentType]
    if kind == "order":
        return value.astype(value.dtype.newbyteorder())
    if kind == "masked":
        return np.ma.masked_array(value, draw.odd(0.5))
    return value.tolist()


def gathered(draw: Draw, values: list[Any]) -> Any:
    """Return a sequence of arrays as another kind of container, or with another kind of item."""
    kind = draw.pick(["tuple", "once", "item", "item", "keys", "table"])
    if kind == "tuple":
        return tuple(values)
    if kind == "once":
        return Once(values)
    if kind == "keys":
        return dict(enumerate(values))
    if kind == "table":
        return Frame(np.zeros((len(values), 3)))
    n = int(draw.rng.integers(len(values)))
    item = disguised(draw, values[n]) if type(values[n]) is np.ndarray else values[n]
    return [*values[:n], item, *values[n + 1 :]]
