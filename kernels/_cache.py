"""Folders of compiled kernels, for both kernel sets: what to do where nothing can be written."""

from __future__ import annotations

import os
import tempfile
import warnings

# The variable by which a user of each set chooses the folder.
VARIABLES = {"warp": "WARP_CACHE_PATH", "taichi": "TI_OFFLINE_CACHE_FILE_PATH"}


def refusal(folder: str | os.PathLike[str]) -> str:
    """Return why no file can be written in `folder`, made if missing; empty if one can be."""
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"cvkern")
    except OSError as error:
        return error.strerror or type(error).__name__
    return ""


def warn(kernel_set: str, folder: str | os.PathLike[str], reason: str) -> None:
    """Say that compiled kernels are not kept, and what to set."""
    warnings.warn(
        f"kernels cannot be kept in {os.fspath(folder)} ({reason}): they are compiled for this "
        f"process alone; set {VARIABLES[kernel_set]} to a folder that can be written to",
        RuntimeWarning,
        stacklevel=3,
    )
