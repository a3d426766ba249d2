"""Structures of kernels from the named tuples that the API hands over."""

from collections.abc import Iterable
from typing import Any


def struct_of(kind: Any, values: Iterable[Any]) -> Any:
    """Return a Warp structure of these values, in the order of its fields."""
    made = kind()
    for name, value in zip(kind.vars, values, strict=True):
        setattr(made, name, value)
    return made
