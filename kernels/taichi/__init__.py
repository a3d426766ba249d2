"""The Taichi kernel set: arrays here, primitives in the modules of this folder.

Arrays are NumPy's on the CPU, and for Vulkan and Metal (_staging.py). On CUDA they are Warp's,
which provide memory and DLPack without torch; Taichi gets their addresses. Modules of this folder
must not use ``from __future__ import annotations``, because Taichi reads annotations as objects.
"""

import contextlib
import os
import warnings
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np

# Read by Taichi: no banner on import, no request to its version server on start.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")
os.environ.setdefault("TI_LOG_LEVEL", "error")  # it would report that stdout is not a terminal
with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # locale.getdefaultlocale
    warnings.simplefilter("ignore", SyntaxWarning)  # escapes in its docstrings
    import taichi  # noqa: F401  (before the modules of this folder import it)

from ._launch import devices, start, synchronize

__all__ = [
    "adopt",
    "clear",
    "devices",
    "empty",
    "free_memory",
    "import_dlpack",
    "own_scratch",
    "record",
    "release_memory",
    "scratch",
    "start",
    "to_numpy",
    "view",
    "write",
    "zeros",
]
MATRIX_DTYPES = {"cpu": "float32", "cuda": "float32"}


def adopt(array: np.ndarray, dtype: np.dtype, shape: tuple[int, ...], device: str) -> Any:
    """View a contiguous host array for kernels, bool as uint8; copy it if the device is a GPU."""
    if device == "cpu":
        host = array.reshape(shape)
        return host.view(np.uint8) if dtype == np.bool_ else np.require(host, None, "CA")
    from . import _cuda

    return _cuda.upload(array, shape)


def view(address: int, owner: Any, dtype: np.dtype, shape: tuple[int, ...], device: str) -> Any:
    """View the memory of `owner`, contiguous at `address`, for kernels, bool as uint8."""
    if device == "cpu":
        return adopt(np.asarray(owner), dtype, shape, device)
    from . import _cuda

    return _cuda.view(address, owner, dtype, shape)


def import_dlpack(array: Any, dtype: np.dtype, shape: tuple[int, ...]) -> Any:
    """View an array of a GPU by DLPack, which makes Warp's stream wait for its library's."""
    from . import _cuda

    taken = _cuda.wp.from_dlpack(array)
    return _cuda.view(taken.ptr or 0, taken, dtype, shape)


def empty(shape: tuple[int, ...], dtype: np.dtype, device: str) -> Any:
    """Allocate an uninitialised array."""
    if device == "cpu":
        return np.empty(shape, dtype)
    from . import _cuda

    return _cuda.empty(shape, dtype)


def zeros(shape: tuple[int, ...], dtype: np.dtype, device: str) -> Any:
    """Allocate an array of 0; on the CPU, its pages are cleared only when they are written."""
    if device == "cpu":
        return np.zeros(shape, dtype)
    array = empty(shape, dtype, device)
    clear(array)
    return array


def stream(device: str) -> int:
    """Return the address of the CUDA stream that launches go to: the default stream."""
    return 0


def free_memory(device: str) -> int:
    """Return the number of free bytes on a GPU."""
    from . import _cuda

    return _cuda.free_memory()


def scratch(name: str, shape: tuple[int, ...], dtype: np.dtype, device: str) -> Any:
    """Return memory that stays valid until this thread asks for `name` again."""
    return empty(shape, np.dtype(np.uint8 if dtype == np.bool_ else dtype), device)


def write(array: Any, values: np.ndarray) -> None:
    """Copy contiguous host values of its shape and dtype into `array`; wait for that on CUDA."""
    if isinstance(array, np.ndarray):
        array[...] = values
    else:
        from . import _cuda

        _cuda.fill(array, values)


def clear(array: Any) -> None:
    """Fill `array` with 0."""
    if isinstance(array, np.ndarray):
        array[...] = 0
    else:
        import warp as wp

        synchronize()
        array.zero_()
        wp.synchronize_stream(array.device.stream)  # Taichi launches on another stream


def to_numpy(array: Any) -> np.ndarray:
    """Wait for the kernels that fill `array`, then copy it to the host (no copy on the CPU)."""
    if isinstance(array, np.ndarray):
        return array
    synchronize()
    return array.numpy()


def release_memory() -> None:
    """Free the memory that is kept for later calls: none here, except Taichi's own pools."""


def own_scratch(scratch: dict[Any, Any]) -> contextlib.AbstractContextManager[None]:
    """Keep scratch apart for the block; always so here, as each call allocates new scratch."""
    return contextlib.nullcontext()


def repeat(key: Hashable, call: Callable[[], None], arrays: Sequence[Any]) -> None:
    """Make the call each time: Taichi has no graphs."""
    call()


def record(call: Callable[[], None], device: str) -> Callable[[], None]:
    """Return a function that repeats the launches: `call` itself, because Taichi has no graphs."""
    return call
