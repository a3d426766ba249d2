"""The number of threads of CPU kernels, for both kernel sets."""

from __future__ import annotations

import os
import threading
from functools import lru_cache


def cpu_threads() -> int:
    """Return ``CVKERN_NUM_THREADS``, or the number of cores that this process may use.

    Raises
    ------
    ValueError
        If the variable is not an integer of at least 1.
    """
    asked = os.environ.get("CVKERN_NUM_THREADS")
    if asked:
        return _parsed(asked)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@lru_cache
def _parsed(asked: str) -> int:
    if not asked.isdecimal() or int(asked) < 1:
        raise ValueError(f"CVKERN_NUM_THREADS must be an integer >= 1, got {asked!r}")
    return int(asked)


class _Share(threading.local):
    """The part of the cores that launches of a thread use: one of so many."""

    parts = 1


_share = _Share()


def share_cores(parts: int) -> None:
    """Let the launches of this thread use one of so many parts of the cores."""
    _share.parts = parts


def launch_threads() -> int:
    """Return how many threads a launch of this thread may use."""
    return -(-cpu_threads() // _share.parts)
