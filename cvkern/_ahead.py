"""Kernels of calls that need many: compiled on other threads while the call begins."""

from __future__ import annotations

import importlib
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from cvkern._runtime import choice, use
from cvkern.kernels._cache import MEANWHILE
from cvkern.kernels._threads import cpu_threads


@contextmanager
def compiles_ahead(*names: str) -> Iterator[None]:
    """Compile what the functions `names`, ``FAMILY.NAME``, need while the block computes.

    When the block must wait for the first kernel for the CPU that is not in the cache, the warm-up
    calls of these functions begin on other threads, the first name first, and the block ends after
    them. If the cache has all kernels, nothing happens.
    """
    if MEANWHILE.get():  # in another such block
        yield
        return
    others = _Others(names)
    token = MEANWHILE.set(others.begin)
    try:
        yield
    finally:
        MEANWHILE.reset(token)
        others.end()


class _Others:
    """Calls on other threads."""

    def __init__(self, names: tuple[str, ...]):
        self._names = names
        self._left: Iterator[Callable[[], object]] = iter(())
        self._threads: list[threading.Thread] = []
        self._ended = False

    def begin(self) -> None:
        """Begin to compile, if this is the first time and there are more cores."""
        if self._threads or cpu_threads() == 1:
            return
        backend = choice()[0]
        self._left = iter([*map(warm_up_call, self._names)])
        for _ in range(min(cpu_threads(), len(self._names))):
            thread = threading.Thread(target=self._work, args=(backend,), daemon=True)
            self._threads.append(thread)
            thread.start()

    def _work(self, backend: str) -> None:
        with use(backend, "cpu"):
            for call in self._left:
                if self._ended:
                    return
                with suppress(Exception):  # the call that needs the kernel will report it
                    call()

    def end(self) -> None:
        """Begin no more calls, and wait for those that run."""
        self._ended = True
        for thread in self._threads:
            thread.join()


def warm_up_call(name: str) -> Callable[[], object]:
    """Return the first warm-up call of a function, ``FAMILY.NAME``."""
    family, _, function = name.partition(".")
    calls = importlib.import_module(f"cvkern.{family}._warmup").calls()
    return next(call for name, call in calls if name == function)
