"""Calls that compile every kernel of a set, collected from each family's ``_warmup.py``."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import cvkern


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every public function and every dtype with its own kernels."""
    for path in sorted(Path(cvkern.__file__).parent.glob("*/_warmup.py")):
        yield from importlib.import_module(f"cvkern.{path.parent.name}._warmup").calls()


def pictures() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a small picture of noise as uint8, as float32, and as float32 with three channels."""
    byte = np.random.default_rng(0).integers(0, 256, (24, 40)).astype(np.uint8)
    real = byte.astype(np.float32)
    return byte, real, np.repeat(real[..., None], 3, axis=2)
