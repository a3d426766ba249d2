"""Calls that compile the kernels of point clouds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from cvkern.app.warmup import pictures
from cvkern.clouds import turntable


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function that has kernels."""
    byte, real, _ = pictures()
    yield "turntable", partial(turntable, real.reshape(-1, 3) + 1, byte.reshape(-1, 3), frames=1)
