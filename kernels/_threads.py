"""The number of threads of CPU kernels, for both kernel sets."""

from __future__ import annotations

import os
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
