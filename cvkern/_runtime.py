"""The choice of kernel set and device for a call, and the way of arrays to kernels and back.

This module and `_sets.py` alone know that there is more than one kernel framework.
"""

from __future__ import annotations

import importlib
import math
import os
import re
import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from contextvars import ContextVar
from functools import lru_cache
from typing import Any

import numpy as np

from cvkern import _arrays
from cvkern._arrays import NUMPY, Library, Order
from cvkern._checks import as_items
from cvkern._kernels import Folder
from cvkern._memory import trim
from cvkern._sets import KERNEL_SETS
from cvkern._sets import kernel_set as _kernel_set
from cvkern._sets import refuse_absent as _refuse_absent
from cvkern._tape import capturing, keep_constant, keep_result, refuse_capture

DEVICES = "'cpu', 'cuda', 'cuda:N', 'vulkan' or 'metal'"
_MAX_CONSTANTS = 256
_PIECE = 256  # bytes at whose multiples arrays begin that are copied together

_chosen: ContextVar[tuple[str, str] | None] = ContextVar("cvkern", default=None)


class use:
    """Choose the kernel set, and the device for NumPy arrays, for the calls that follow.

    As a statement it holds until the next one in this thread (or asyncio task); in a ``with``
    statement it holds for the block. The environment variables ``CVKERN_BACKEND`` and
    ``CVKERN_DEVICE`` set the defaults; they are read at the first call.

    Parameters
    ----------
    backend : {'warp', 'taichi'}, optional
        The kernel set; unchanged when omitted.
    device : str, optional
        ``"cpu"``, ``"cuda"`` or ``"cuda:N"``: the device that computes calls on NumPy arrays.
        Taichi also has ``"vulkan"``, for GPUs of any maker, and ``"metal"``, which is untried.
        Calls on arrays of a GPU always run on that GPU. Unchanged when omitted.

    Raises
    ------
    ValueError
        If either is unknown, or the device does not exist here (see :func:`devices`).
    ImportError
        If the kernel set is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> with cvkern.use(backend="taichi"):
    ...     cvkern.gaussian(np.ones((2, 3)), 1.0).shape
    (2, 3)
    """

    def __init__(self, backend: str | None = None, device: str | None = None):
        before = _chosen.get() or _environment()
        new = (b if a is None else a for a, b in zip((backend, device), before, strict=True))
        self._token = _chosen.set(_checked(*new))

    def __enter__(self) -> use:
        return self

    def __exit__(self, *exc: object) -> None:
        _chosen.reset(self._token)


def choice() -> tuple[str, str]:
    """Return the kernel set and the device in use; other threads do not inherit them."""
    return _chosen.get() or _default()


@lru_cache
def _default() -> tuple[str, str]:
    return _checked(*_environment())


@lru_cache
def _environment() -> tuple[str, str]:
    return os.environ.get("CVKERN_BACKEND") or "warp", os.environ.get("CVKERN_DEVICE") or "cpu"


def _checked(backend: str, device: str) -> tuple[str, str]:
    if not isinstance(backend, str) or backend not in KERNEL_SETS:
        raise ValueError(f"backend must be one of {KERNEL_SETS}, got {backend!r}")
    if not isinstance(device, str) or not re.fullmatch(r"cpu|cuda(:\d+)?|vulkan|metal", device):
        raise ValueError(f"device must be {DEVICES}, got {device!r}")
    device = "cuda:0" if device == "cuda" else device
    _refuse_absent(backend, device)
    return backend, device


def devices(backend: str | None = None) -> tuple[str, ...]:
    """Return the devices of this machine that a kernel set can use.

    Parameters
    ----------
    backend : {'warp', 'taichi'}, optional
        The kernel set; the one in use when omitted.

    Returns
    -------
    tuple of str
        ``"cpu"``, then ``"cuda:N"`` for each GPU, as :class:`use` takes them. Taichi drives only
        the first GPU; it adds ``"vulkan"`` and ``"metal"`` where there are drivers.

    Raises
    ------
    ValueError
        If the kernel set is unknown.
    ImportError
        If it is not installed.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.devices()[0]
    'cpu'
    """
    backend = (_chosen.get() or _environment())[0] if backend is None else backend
    return _kernel_set(_checked(backend, "cpu")[0]).devices()


def release_memory() -> None:
    """Free the memory that cvkern keeps for later calls.

    Each thread keeps the scratch memory of its calls: on the host at most ``CVKERN_SCRATCH_MB``
    mebibytes in all threads together, by default 1024. This function frees all scratch memory on
    the host, that of this thread on GPUs, and the host memory that is kept of earlier results, at
    most 256 MiB and as much pinned. Other threads free theirs on GPUs at their next call that uses
    some, and keep what their repeated calls on small images use, some MiB. Running calls of other
    threads are not disturbed. The memory of a captured call (:func:`capture`) stays.

    Raises
    ------
    ValueError
        If called while :func:`capture` records.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.release_memory()
    """
    refuse_capture("release_memory")
    for name in KERNEL_SETS:
        loaded = sys.modules.get(f"cvkern.kernels.{name}")
        if loaded is not None:
            loaded.release_memory()
    importlib.import_module("cvkern._plans").forget()
    trim()


class Runtime(Folder):
    """One kernel set on one device, for the arrays of one library.

    ``rt.FAMILY.MODULE.PRIMITIVE(...)`` launches a kernel of the set.
    """

    def __init__(self, name: str, device: str, library: Library):
        importlib.import_module("cvkern.kernels._threads").cpu_threads()  # checks the environment
        super().__init__(f"cvkern.kernels.{name}")
        self._place = device
        self.name, self.library = name, library
        self.device = device = "cpu" if device in ("vulkan", "metal") else device
        self._set = _kernel_set(name)
        self._constants: dict[Any, Any] = {}
        # The caller's library allocates results, unless kernels cannot write to its arrays there.
        self._allocates = library if library.writable else NUMPY
        self._own_results = device != "cpu" and self._allocates is NUMPY

    def start(self) -> None:
        """Prepare the kernel set for this thread, on the caller's stream."""
        stream = None if self.device == "cpu" else self.library.stream(self.device)
        self._set.start(self._place, stream)

    def adopt(self, array: Any, dtype: Any = np.float32, shape: Any = None) -> Any:
        """View `array` for kernels: contiguous, of `dtype` and `shape`, copied only if necessary.

        Kernels must only read the view of an input: it may be the caller's own memory.
        """
        dtype, library, device = np.dtype(dtype), _arrays.library(array), self.device
        ready = library.contiguous(array, dtype)
        if ready is not array and device != "cpu" and capturing():
            raise ValueError(
                f"captured arrays must be contiguous and {dtype.name} on a GPU, "
                f"got {library.dtype(array).name}"
            )
        shape = tuple(shape or ready.shape)
        if library is NUMPY:
            return self._set.adopt(ready, dtype, shape, device)
        if library.order is Order.DLPACK and device != "cpu":
            return self._set.import_dlpack(ready, dtype, shape)
        return self._set.view(*library.memory(ready, device), dtype, shape, device)

    def adopt_mask(self, mask: Any) -> Any:
        """View `mask` for kernels as bool or uint8: whatever its dtype, pixels not 0 are set."""
        given = _arrays.library(mask).dtype(mask)
        return self.adopt(mask, given if given in (np.bool_, np.uint8) else np.bool_)

    def constant(self, array: np.ndarray) -> Any:
        """View a small host array that never changes; it is copied to the device once."""
        key = (array.dtype.char, array.shape, array.tobytes())
        if key not in self._constants:
            if len(self._constants) >= _MAX_CONSTANTS:
                self._constants.pop(next(iter(self._constants)))
            self._constants[key] = self._set.adopt(array, array.dtype, array.shape, self.device)
        return keep_constant(self._constants[key])

    def empty(self, shape: tuple[int, ...], dtype: Any = np.float32, out: Any = None) -> Any:
        """Allocate a result, in the caller's library if kernels can write to its arrays.

        The result is `out` itself if kernels can reach it; a GPU cannot reach NumPy's memory.
        """
        if out is not None and (self.library is not NUMPY or self.device == "cpu"):
            return out
        if self._own_results and capturing():
            raise ValueError(
                "captured arrays must be of a library that can write to them on a GPU, "
                f"got {type(self.library).__name__}"
            )
        return keep_result(self._allocate, shape, np.dtype(dtype))

    def _allocate(self, shape: tuple[int, ...], dtype: np.dtype) -> Any:
        if self._own_results:
            return self._set.empty(shape, dtype, self.device)
        return self._allocates.empty(shape, dtype, self.device)

    def result_library(self) -> Library:
        """Return the library of the arrays that :meth:`empty` allocates."""
        return _arrays.library(self._allocate((1,), np.dtype(np.uint8)))

    def scratch(self, name: str, shape: tuple[int, ...], dtype: Any = np.float32) -> Any:
        """Return kernel memory that stays valid until this thread asks for `name` again."""
        return self._set.scratch(name, shape, np.dtype(dtype), self.device)

    def send(self, name: str, values: np.ndarray) -> Any:
        """Copy a host array to kernels; it stays valid until this thread asks for `name` again.

        On a GPU, its memory stays valid after the call returns, unlike that of :meth:`adopt`.
        """
        if self.device == "cpu":
            return self.adopt(values, values.dtype)
        array = self.scratch(name, values.shape, values.dtype)
        self.write(array, values)
        return array

    def send_all(self, name: str, *values: np.ndarray) -> list[Any]:
        """Copy several host arrays as :meth:`send` does, on a GPU in one piece."""
        if self.device == "cpu":
            return [self.adopt(v, v.dtype) for v in values]
        begins = np.cumsum([0, *(-(-v.nbytes // _PIECE) * _PIECE for v in values)]).tolist()
        together = np.zeros(max(begins[-1], 1), np.uint8)
        for v, begin in zip(values, begins, strict=False):
            together[begin : begin + v.nbytes] = np.ascontiguousarray(v).reshape(-1).view(np.uint8)
        room = self.send(name, together)
        return [
            self._set.view(room.ptr + begin, room, v.dtype, v.shape, self.device)
            for v, begin in zip(values, begins, strict=False)
        ]

    def zeros(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Any:
        """Allocate kernel memory that is not shared as scratch is, filled with 0."""
        return self._set.zeros(shape, np.dtype(dtype), self.device)

    def clear(self, array: Any) -> None:
        """Fill a kernel array with 0."""
        self._set.clear(array)

    def write(self, array: Any, values: np.ndarray) -> None:
        """Copy host values of the same shape and dtype into a kernel array."""
        self._set.write(array, np.ascontiguousarray(values))

    def stream(self) -> int:
        """Return the address of this thread's CUDA stream."""
        return self._set.stream(self.device)

    def free_memory(self) -> int:
        """Return the number of free bytes on a GPU."""
        return self._set.free_memory(self.device)

    def host_view(self, array: Any) -> np.ndarray:
        """View an array of the CPU for NumPy; unlike :meth:`to_numpy`, in captured calls too."""
        return self._set.to_numpy(array)

    def own_scratch(self, scratch: dict[Any, Any]) -> AbstractContextManager[None]:
        """Keep the scratch memory of the block in `scratch`, apart from that of other calls."""
        return self._set.own_scratch(scratch)

    def record(self, call: Callable[[], None]) -> Callable[[], None]:
        """Return a function that repeats the launches of `call`, if possible by one launch.

        This thread must have run `call` before: the launches use the same scratch memory again.
        """
        return self._set.record(call, self.device)

    def repeat(self, key: Any, call: Callable[[], None], arrays: Sequence[Any]) -> None:
        """Launch `call`, which its key and arrays determine; Warp on CUDA repeats it by a graph."""
        self._set.repeat(key, call, arrays)

    def plan(self, call: Callable[[], Any], image: Any, results: list[Any]) -> tuple[Any, Any]:
        """Return the result of `call`, and the plan of its launches, or None if it has no plan.

        `call` reads `image` only, and lists the arrays that it allocates in `results`.
        """
        with self._set.noting() as notes:
            returned = call()
        spans = []
        for array in (image, *results):
            size = math.prod(array.shape) * self.library.dtype(array).itemsize
            spans.append((self.library.memory(array, self.device)[0], size))
        return returned, self._set.plan_of(notes, spans)

    @property
    def matrix_dtype(self) -> np.dtype:
        """The precision of matrix products: half on devices with tensor cores."""
        return np.dtype(self._set.MATRIX_DTYPES[self.device.partition(":")[0]])

    def release(self, result: Any, out: Any = None) -> Any:
        """Return a filled result of :meth:`empty` as the caller's array."""
        if out is not None:
            if result is not out:
                self.library.fill(out, self.release(result))
            return out
        if self.library is NUMPY:
            return result if isinstance(result, np.ndarray) else self.to_numpy(result)
        return self.library.finish(result)

    def give(self, values: np.ndarray) -> Any:
        """Convert a host array to the caller's library, on the caller's device."""
        refuse_capture("a result found on the host")
        if self.library is NUMPY:
            return values
        result = self.empty(values.shape, values.dtype)
        if self.device == "cpu":
            np.asarray(result)[...] = values
        elif values.size:
            self.write(self.adopt(result, values.dtype), values)
        return self.release(result)

    def to_numpy(self, array: Any) -> np.ndarray:
        """Wait for a kernel array and copy it to the host."""
        refuse_capture("a value needed on the host")
        return self._set.to_numpy(array)


def check_devices(devices: Sequence[str] | None) -> list[str]:
    """Return the devices that a call names, all of which exist; by default that in use."""
    found = (choice()[1],) if devices is None else as_items(devices, "devices", "names of devices")
    if not found:
        raise ValueError("devices must name at least one, got none")
    return [_checked(choice()[0], place)[1] for place in found]


def pinned() -> Callable[[], use]:
    """Return a function that makes a context with the current kernel set and device."""
    backend, device = choice()
    return lambda: use(backend, device)


_runtimes: dict[tuple[str, str, Library], Runtime] = {}


def runtime(*arrays: Any) -> Runtime:
    """Return the chosen kernel set, ready on the device and the stream of `arrays`."""
    name, device = choice()
    library, places = NUMPY, set()
    for array in arrays:
        of = _arrays.library(array)
        if of is not NUMPY:
            library = of if library is NUMPY else library
            places.add(of.device(array))
    if len(places) > 1:
        raise ValueError(f"arrays must be on one device, got {', '.join(sorted(places))}")
    if places:
        device = places.pop()
    key = (name, device, library)
    rt = _runtimes.get(key) or _runtimes.setdefault(key, Runtime(name, device, library))
    rt.start()
    return rt
