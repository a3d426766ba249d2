"""The results of a captured call: kept by the recording, filled again by each replay."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any


class _Tape(threading.local):
    """The recording of this thread's current capture; empty outside of a capture."""

    results: list[Any] | None = None
    constants: list[Any] | None = None
    replayed: Iterator[Any] | None = None


_tape = _Tape()


@contextlib.contextmanager
def taped(results: list[Any], constants: list[Any], *, replay: bool = False) -> Iterator[None]:
    """Keep the results that the block allocates in `results`, or return those again in a replay.

    The constants that it uses are kept as well, because a CUDA graph holds their addresses.
    """
    before = _tape.results, _tape.constants, _tape.replayed
    _tape.results, _tape.constants = results, constants
    _tape.replayed = iter(results) if replay else None
    try:
        yield
    finally:
        _tape.results, _tape.constants, _tape.replayed = before


def capturing() -> bool:
    """Tell whether this thread is in a captured call."""
    return _tape.results is not None


def keep_result(allocate: Callable[..., Any], *args: Any) -> Any:
    """Return ``allocate(*args)``; in a replay, return the array of the recording instead."""
    if _tape.results is None:
        return allocate(*args)
    if _tape.replayed is not None:
        return next(_tape.replayed)
    result = allocate(*args)
    _tape.results.append(result)
    return result


def keep_constant(constant: Any) -> Any:
    """Keep a constant as long as the captured call, and return it."""
    if _tape.constants is not None:
        _tape.constants.append(constant)
    return constant


def refuse_capture(name: str) -> None:
    """Raise inside :func:`capture`, for work that is not done by kernels alone."""
    if capturing():
        raise ValueError(f"captured functions must be kernels alone, got {name}")
