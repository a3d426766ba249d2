"""Which kernel set runs a call, on which device, and how arrays cross into it and back.

This is the only module that knows there is more than one kernel framework.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import re
import threading
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from functools import lru_cache
from typing import Any

import numpy as np

from cvkern import _arrays
from cvkern._kernels import Folder

KERNEL_SETS = ("warp", "taichi")
_MAX_CONSTANTS = 256

_chosen: ContextVar[tuple[str, str] | None] = ContextVar("cvkern", default=None)


class use:
    """Choose the kernel set, and the device of NumPy work, for the calls that follow.

    A statement holds until the next one in this thread (or asyncio task), ``with`` for its block.
    The environment variables ``CVKERN_BACKEND`` and ``CVKERN_DEVICE``, as they are at the first
    call, set the defaults.

    Parameters
    ----------
    backend : {'warp', 'taichi'}, optional
        The kernel set; unchanged when omitted.
    device : str, optional
        ``"cpu"``, ``"cuda"`` or ``"cuda:N"``: where NumPy arrays are computed. Arrays that live
        on a GPU are computed there in any case. Unchanged when omitted.

    Raises
    ------
    ValueError
        If either is unknown. A device that is not there is found out by the first call.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> with cvkern.use(backend="taichi"):
    ...     cvkern.gaussian(np.ones((2, 3)), 1.0).shape
    (2, 3)
    """

    def __init__(self, backend: str | None = None, device: str | None = None):
        old_backend, old_device = _choice()
        self._token = _chosen.set(
            _checked(
                old_backend if backend is None else backend,
                old_device if device is None else device,
            )
        )

    def __enter__(self) -> use:
        return self

    def __exit__(self, *exc: object) -> None:
        _chosen.reset(self._token)


def _choice() -> tuple[str, str]:
    return _chosen.get() or _default()


@lru_cache
def _default() -> tuple[str, str]:
    backend, device = os.environ.get("CVKERN_BACKEND"), os.environ.get("CVKERN_DEVICE")
    return _checked(backend or "warp", device or "cpu")


def _checked(backend: str, device: str) -> tuple[str, str]:
    if backend not in KERNEL_SETS:
        raise ValueError(f"backend must be one of {KERNEL_SETS}, got {backend!r}")
    if not isinstance(device, str) or not re.fullmatch(r"cpu|cuda(:\d+)?", device):
        raise ValueError(f"device must be 'cpu', 'cuda' or 'cuda:N', got {device!r}")
    return backend, "cuda:0" if device == "cuda" else device


class Runtime(Folder):
    """One kernel set on one device, for the arrays of one library.

    ``rt.FAMILY.MODULE.PRIMITIVE(...)`` launches a kernel of the set.
    """

    def __init__(self, name: str, device: str, library: _arrays.NumPy):
        threads = os.environ.get("CVKERN_NUM_THREADS") or "1"
        if not threads.isdecimal() or int(threads) < 1:
            raise ValueError(f"CVKERN_NUM_THREADS must be an integer >= 1, got {threads!r}")
        super().__init__(f"cvkern.kernels.{name}")
        self.name, self.device, self.library = name, device, library
        self.set = importlib.import_module(f"cvkern.kernels.{name}")
        self._constants: dict[Any, Any] = {}

    def adopt(self, array: Any, dtype: Any = np.float32, shape: Any = None) -> Any:
        """View `array` for kernels, contiguous, of `dtype` and `shape`; a copy only where it must.

        The view of an input is for reading only: it may be the caller's own memory.
        """
        dtype, library = np.dtype(dtype), _arrays.library(array)
        ready = library.contiguous(array, dtype)
        if ready is not array and _tape.buffers is not None and self.device != "cpu":
            raise ValueError(
                f"captured arrays must be contiguous and {dtype.name} on a GPU, "
                f"got {library.dtype(array).name}"
            )
        return self.set.adopt(ready, dtype, tuple(shape or ready.shape), self.device)

    def constant(self, array: np.ndarray) -> Any:
        """View a small host array that never changes, moved to the device once."""
        key = (array.dtype.char, array.shape, array.tobytes())
        if key not in self._constants:
            if len(self._constants) >= _MAX_CONSTANTS:
                self._constants.pop(next(iter(self._constants)))
            self._constants[key] = self.set.adopt(array, array.dtype, array.shape, self.device)
        if _tape.constants is not None:
            _tape.constants.append(self._constants[key])
        return self._constants[key]

    def empty(self, shape: tuple[int, ...], dtype: Any = np.float32, out: Any = None) -> Any:
        """Allocate a result, in the caller's library where that can be written to.

        It is `out` itself where kernels reach that: not NumPy's memory from a GPU.
        """
        if out is not None and (self.library is not _NUMPY or self.device == "cpu"):
            return out
        if _tape.replayed is not None:
            return next(_tape.replayed)
        ours = self.library is _NUMPY or not self.library.writable  # on a GPU
        if _tape.buffers is not None and self.device != "cpu" and ours:
            raise ValueError(
                "captured arrays must be of a library that can write to them on a GPU, "
                f"got {type(self.library).__name__}"
            )
        dtype = np.dtype(dtype)
        if self.device == "cpu":
            result = (self.library if self.library.writable else _NUMPY).empty(shape, dtype, "cpu")
        elif not ours:
            result = self.library.empty(shape, dtype, self.device)
        else:
            result = self.set.empty(shape, dtype, self.device)
        if _tape.buffers is not None:
            _tape.buffers.append(result)
        return result

    def scratch(self, name: str, shape: tuple[int, ...], dtype: Any = np.float32) -> Any:
        """Return kernel memory that stays valid until this thread asks for `name` again."""
        return self.set.scratch(name, shape, np.dtype(dtype), self.device)

    def send(self, name: str, values: np.ndarray) -> Any:
        """Bring a host array to kernels; it stays valid until this thread asks for `name` again.

        Unlike that of :meth:`adopt`, its memory on a GPU outlives the call that launches kernels.
        """
        if self.device == "cpu":
            return self.adopt(values, values.dtype)
        array = self.scratch(name, values.shape, values.dtype)
        self.write(array, values)
        return array

    def zeros(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Any:
        """Allocate kernel memory of one's own, filled with 0."""
        return self.set.zeros(shape, np.dtype(dtype), self.device)

    def clear(self, array: Any) -> None:
        """Fill a kernel array with 0."""
        self.set.clear(array)

    def write(self, array: Any, values: np.ndarray) -> None:
        """Copy host values of the same shape and dtype into a kernel array."""
        self.set.write(array, np.ascontiguousarray(values))

    def free_memory(self) -> int:
        """Return how many bytes a GPU has left."""
        return self.set.free_memory(self.device)

    def record(self, call: Callable[[], None]) -> Callable[[], None]:
        """Return what repeats the launches of `call`, as one where the kernel set can do that.

        This thread has done `call` before: its launches use the scratch memory that they used then.
        """
        return self.set.record(call, self.device)

    @property
    def captured(self) -> bool:
        """Whether :func:`cvkern.capture` records or repeats this call."""
        return _tape.buffers is not None

    @property
    def matrix_dtype(self) -> np.dtype:
        """The precision of matrix products: half where there are tensor cores for it."""
        return np.dtype(self.set.MATRIX_DTYPES[self.device.partition(":")[0]])

    def release(self, result: Any, out: Any = None) -> Any:
        """Return what :meth:`empty` gave, once kernels have filled it, as the caller's array."""
        if out is not None:
            if result is not out:
                self.library.fill(out, self.release(result))
            return out
        if self.library is _NUMPY:
            return result if isinstance(result, np.ndarray) else self.to_numpy(result)
        return self.library.finish(result)

    def give(self, values: np.ndarray) -> Any:
        """Return a host array as the caller's: of the same library, on the same device."""
        refuse_capture("a result found on the host")
        if self.library is _NUMPY:
            return values
        result = self.empty(values.shape, values.dtype)
        if self.device == "cpu":
            np.asarray(result)[...] = values
        elif values.size:
            self.write(self.adopt(result, values.dtype), values)
        return self.release(result)

    def to_numpy(self, array: Any) -> np.ndarray:
        """Wait for a kernel array and bring it to the host."""
        refuse_capture("a value needed on the host")
        return self.set.to_numpy(array)


def refuse_capture(name: str) -> None:
    """Raise inside :func:`capture` for what is not all done by kernels."""
    if _tape.buffers is not None:
        raise ValueError(f"captured functions must be kernels alone, got {name}")


class _Tape(threading.local):
    """The results of a captured call: recorded by its rehearsal, filled again by its replays."""

    buffers: list[Any] | None = None
    constants: list[Any] | None = None
    replayed: Any = None


_tape = _Tape()


@contextlib.contextmanager
def taped(buffers: list[Any], constants: list[Any], *, replay: bool = False) -> Iterator[None]:
    """Keep the results that the block allocates in `buffers`, or hand those out again.

    The constants that it uses are kept as well: a CUDA graph has their addresses.
    """
    before = _tape.buffers, _tape.constants, _tape.replayed
    _tape.buffers, _tape.constants = buffers, constants
    _tape.replayed = iter(buffers) if replay else None
    try:
        yield
    finally:
        _tape.buffers, _tape.constants, _tape.replayed = before


def pinned() -> Callable[[], use]:
    """Return what brings back, as a context, the kernel set and device chosen now."""
    backend, device = _choice()
    return lambda: use(backend, device)


_NUMPY = _arrays.library(np.empty(0))
_runtimes: dict[tuple[str, str, _arrays.NumPy], Runtime] = {}


def runtime(*arrays: Any) -> Runtime:
    """Return the chosen kernel set, ready on the device and the stream of `arrays`."""
    name, device = _choice()
    library, places = _NUMPY, set()
    for array in arrays:
        of = _arrays.library(array)
        if of is not _NUMPY:
            library = of if library is _NUMPY else library
            places.add(of.device(array))
    if len(places) > 1:
        raise ValueError(f"arrays must be on one device, got {', '.join(sorted(places))}")
    if places:
        device = places.pop()
    key = (name, device, library)
    rt = _runtimes.get(key)
    if rt is None:
        rt = _runtimes.setdefault(key, Runtime(name, device, library))
    rt.set.start(device, library.stream(device) if device != "cpu" else None)
    return rt
