"""Calls that compile every kernel of a set, collected from each family's ``_warmup.py``."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

import numpy as np

import cvkern
from cvkern._runtime import choice, pinned
from cvkern.kernels._threads import cpu_threads


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every public function and every dtype with its own kernels."""
    for path in sorted(Path(cvkern.__file__).parent.glob("*/_warmup.py")):
        yield from importlib.import_module(f"cvkern.{path.parent.name}._warmup").calls()


def compile_all() -> Iterator[tuple[int, int, str]]:
    """Make all calls, several at a time on the CPU; yield how many of how many, and a name."""
    most = cpu_threads() if choice()[1] == "cpu" else 1
    chosen, todo = pinned(), list(calls())

    def make(name: str, call: Callable[[], object]) -> str:
        with chosen():
            call()
        return name

    with ThreadPoolExecutor(most, thread_name_prefix="cvkern-warmup") as threads:
        made = [threads.submit(make, *named) for named in todo]
        try:
            for done, future in enumerate(as_completed(made), 1):
                yield done, len(todo), future.result()
        finally:
            threads.shutdown(cancel_futures=True)


def pictures() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a small picture of noise as uint8, as float32, and as float32 with three channels."""
    byte = np.random.default_rng(0).integers(0, 256, (24, 40)).astype(np.uint8)
    real = byte.astype(np.float32)
    return byte, real, np.repeat(real[..., None], 3, axis=2)
