"""Folders of compiled kernels, for both kernel sets, and a warning if they cannot be written."""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
import warnings
from collections.abc import Callable
from contextvars import ContextVar

# The environment variable that chooses the folder of each set.
VARIABLES = {"warp": "WARP_CACHE_PATH", "taichi": "TI_OFFLINE_CACHE_FILE_PATH"}

# Seconds; Taichi holds its lock while it reads or writes the list of kernels, for less than one.
OLD = 60.0

# What the caller does before it waits for a kernel for the CPU that is not in the cache.
MEANWHILE: ContextVar[Callable[[], None] | None] = ContextVar("cvkern_meanwhile", default=None)


def refusal(folder: str | os.PathLike[str]) -> str:
    """Create `folder` if missing; return why no file can be written there, or an empty string."""
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"cvkern")
    except OSError as error:
        return error.strerror or type(error).__name__
    return ""


def unlock(path: str | os.PathLike[str]) -> None:
    """Remove the lock that a killed process left, with which no process would use the cache."""
    with contextlib.suppress(OSError):  # there is none, or another process was faster
        if time.time() - os.stat(path).st_mtime > OLD:
            os.remove(path)


def warn(kernel_set: str, folder: str | os.PathLike[str], reason: str) -> None:
    """Warn that compiled kernels are not kept, and name the variable to set."""
    warnings.warn(
        f"kernels cannot be kept in {os.fspath(folder)} ({reason}): they are compiled for this "
        f"process only; set {VARIABLES[kernel_set]} to a writable folder",
        RuntimeWarning,
        stacklevel=3,
    )
