"""The kernel sets, and which of them can be used here."""

from __future__ import annotations

import importlib
import importlib.util
from functools import lru_cache
from typing import Any

KERNEL_SETS = ("warp", "taichi")
# The framework that each set is written in, and the package that installs it.
PACKAGES = {"warp": ("warp", "warp-lang"), "taichi": ("taichi", "taichi")}


@lru_cache(maxsize=256)
def refuse_absent(backend: str, device: str) -> None:
    """Refuse a kernel set that is not installed, and a device that it does not find."""
    if device == "cpu":
        if importlib.util.find_spec(PACKAGES[backend][0]) is None:
            kernel_set(backend)
    else:
        there = kernel_set(backend).devices()
        if device not in there:
            raise ValueError(
                f"device must be one that {backend} finds here, {there}, got {device!r}"
            )


def kernel_set(backend: str) -> Any:
    """Import a kernel set, which starts no device."""
    package, name = PACKAGES[backend]
    try:
        return importlib.import_module(f"cvkern.kernels.{backend}")
    except ModuleNotFoundError as absent:
        if absent.name != package:
            raise
        others = " or ".join(repr(other) for other in KERNEL_SETS if other != backend)
        raise ImportError(
            f"the {backend!r} backend needs {name}, which is not installed "
            f"(it has no wheels for every Python): use {others}"
        ) from None
