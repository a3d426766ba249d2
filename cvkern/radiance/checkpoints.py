"""Trained fields as files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from cvkern import _archives
from cvkern._archives import Stored, check_path

__all__ = ["Stored", "check_path", "opened", "write"]

KIND = _archives.Kind(
    "cvkern radiance field", 3, ("behind", "marks"), ("cameras", "state", "extra")
)


def write(
    path: str | os.PathLike[str],
    header: dict[str, Any],
    arrays: dict[str, Any],
    *,
    packed: bool = False,
) -> None:
    """Write a model, whole or not at all."""
    _archives.write(path, KIND, header, arrays, packed=packed)


@contextmanager
def opened(path: str | os.PathLike[str]) -> Iterator[tuple[dict[str, Any], Stored]]:
    """Yield the header and the arrays of a model; see :func:`cvkern._archives.opened`."""
    with _archives.opened(path, KIND) as found:
        yield found
