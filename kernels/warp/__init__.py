"""The Warp kernel set: arrays and streams here, primitives in the modules of this folder."""

from __future__ import annotations

import math
import os
import tempfile
import threading
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np
import warp as wp

from . import _pages, _replays, _scratch, _streams
from ._compiling import replace_cache
from ._internals import view_at

_LINE = 64  # bytes of a cache line; rows of this size should not cross two lines

_known_streams: dict[tuple[str, int | None], wp.Stream | None] = {}
_process = 0
_lock = threading.Lock()


def start(device: str, stream: int | None) -> None:
    """Initialise Warp, check `device`, and direct this thread's launches to `stream`."""
    _begin()
    if device == "cpu":
        _streams.set_stream(None)
        return
    if _process != os.getpid():
        raise RuntimeError(
            "CUDA cannot be used in a forked process: start workers with the 'spawn' method"
        )
    _replays.announce()
    key = (device, stream)
    if key not in _known_streams:
        if not wp.is_device_available(device):
            raise ValueError(
                f"device must be one that warp finds here, {devices()}, got {device!r}"
            )
        _known_streams[key] = None if stream is None else wp.Stream(device, cuda_stream=stream)
    _streams.set_stream(_known_streams[key])


def devices() -> tuple[str, ...]:
    """Return the names of the devices that Warp finds."""
    _begin()
    return tuple(device.alias for device in wp.get_devices())


def _begin() -> None:
    global _process
    if not _process:
        with _lock:
            if not _process:
                _initialise()
                _process = os.getpid()


def _initialise() -> None:
    """Start Warp without its native notice on stderr that the machine has no GPU."""
    wp.config.log_level = wp.LOG_ERROR
    with tempfile.TemporaryFile() as said:
        stderr = os.dup(2)
        os.dup2(said.fileno(), 2)
        try:
            _initialise_cache()
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
        said.seek(0)
        lines = said.read().splitlines(keepends=True)
    kept = b"".join(line for line in lines if b"NVIDIA CUDA driver" not in line)
    if kept:
        os.write(2, kept)


def _initialise_cache() -> None:
    try:
        wp.init()
    except OSError as error:  # the folder of the kernel cache cannot be created
        replace_cache(error.strerror or str(error))
        wp.init()


def adopt(array: np.ndarray, dtype: np.dtype, shape: tuple[int, ...], device: str) -> wp.array:
    """View a contiguous host array for kernels, bool as uint8; copy it if the device is a GPU."""
    if device == "cpu":
        return view(array.__array_interface__["data"][0], array, dtype, shape, device)
    _replays.spoil()
    there = wp.array(array, device=device)
    return view(there.ptr or 0, _streams.lend(there), dtype, shape, device)


def view(
    address: int, owner: Any, dtype: np.dtype, shape: tuple[int, ...], device: str
) -> wp.array:
    """View the memory of `owner`, contiguous at `address`, for kernels, bool as uint8."""
    carried = _carried(dtype)
    if isinstance(owner, wp.array) and owner.dtype is carried and owner.shape == shape:
        return owner
    seen = view_at(address, carried, shape, wp.get_device(device))
    seen.owner = owner  # pyright: ignore[reportAttributeAccessIssue]  (keeps the memory alive)
    return seen


def import_dlpack(array: Any, dtype: np.dtype, shape: tuple[int, ...]) -> wp.array:
    """View an array of a GPU by DLPack, which makes Warp's stream wait for its library's."""
    taken = wp.from_dlpack(array)
    return view(taken.ptr or 0, taken, dtype, shape, taken.device.alias)


def empty(shape: tuple[int, ...], dtype: np.dtype, device: str) -> wp.array:
    """Allocate an uninitialised array."""
    scalar = wp.bool if dtype == np.bool_ else wp.dtype_from_numpy(dtype)
    return wp.empty(shape, dtype=scalar, device=device)


def zeros(shape: tuple[int, ...], dtype: np.dtype, device: str) -> wp.array:
    """Allocate an array of 0; on the CPU, its pages are cleared only when they are written."""
    if device == "cpu":
        _replays.spoil()
        size = math.prod(shape) * dtype.itemsize
        room = np.zeros(size + _LINE, np.uint8)
        begin = -room.ctypes.data % _LINE
        return adopt(room[begin : begin + size].view(dtype), dtype, shape, device)
    there = empty(shape, dtype, device)
    array = view(there.ptr or 0, _streams.lend(there), dtype, shape, device)
    clear(array)
    return array


def scratch(name: str, shape: tuple[int, ...], dtype: np.dtype, device: str) -> wp.array:
    """Return memory that stays valid until this thread asks for `name` again."""
    return _scratch.scratch(name, shape, _carried(dtype), wp.get_device(device))


def write(array: wp.array, values: np.ndarray) -> None:
    """Copy contiguous host values of its shape and dtype into `array`; wait for that on CUDA."""
    _replays.spoil()
    host = adopt(values, values.dtype, values.shape, "cpu")
    stream = _streams.current_stream(array.device) if array.device.is_cuda else None
    wp.copy(array, host, stream=stream)
    if stream:
        wp.synchronize_stream(stream)


def clear(array: wp.array) -> None:
    """Fill `array` with 0, in order with the kernels."""
    _replays.spoil()
    if array.device.is_cuda:
        # By default Warp would wait for its own stream here, which a graph cannot record.
        with wp.ScopedStream(_streams.current_stream(array.device), sync_enter=False):
            array.zero_()
    else:
        array.zero_()


def to_numpy(array: wp.array) -> np.ndarray:
    """Wait for the kernels that fill `array`, then copy it to the host (a view on the CPU)."""
    if not array.device.is_cuda:
        return array.numpy()
    _replays.spoil()
    stream = _streams.current_stream(array.device)
    found = _pages.empty(array.shape, np.dtype(wp.dtype_to_numpy(array.dtype)))
    if found.nbytes > _scratch.PAGE:
        wp.copy(adopt(found, found.dtype, found.shape, "cpu"), array, stream=stream)
        wp.synchronize_stream(stream)
    else:
        page = _scratch.page(array.dtype, array.shape)
        wp.copy(page, array, stream=stream)
        wp.synchronize_stream(stream)
        found[...] = page.numpy()
    return found


def stream(device: str) -> int:
    """Return the address of the CUDA stream that this thread's launches go to."""
    return _streams.current_stream(wp.get_device(device)).cuda_stream


def free_memory(device: str) -> int:
    """Return the number of free bytes on a GPU."""
    return wp.get_device(device).free_memory


def release_memory() -> None:
    """Free the memory that is kept for later calls."""
    _scratch.release()
    _replays.release()
    _pages.release()


def repeat(key: Hashable, call: Callable[[], None], arrays: Sequence[wp.array]) -> None:
    """Make the call; on CUDA, repeat its launches as one graph from the second time on.

    All that `call` does must follow from its key and from the addresses and shapes of the arrays,
    which include its inputs and all scratch memory that is used after it.
    """
    if arrays[0].device.is_cuda:
        _replays.repeat(key, call, arrays)
    else:
        call()


own_scratch = _scratch.own_scratch
noting = _replays.noting
plan_of = _replays.plan_of
MATRIX_DTYPES = {"cpu": "float32", "cuda": "float16"}


def record(call: Callable[[], None], device: str) -> Callable[[], None]:
    """Return a function that repeats the launches of `call`; on CUDA, by one launch of a graph.

    While other threads use CUDA, nothing can be recorded: the function is `call` itself.
    """
    if device == "cpu":
        return call
    with _replays.alone() as alone:
        return _recorded(call, device) if alone else call


def _recorded(call: Callable[[], None], device: str) -> Callable[[], None]:
    stream = wp.Stream(device)  # the legacy default stream, which torch uses, cannot record
    scratch = _scratch.known_scratch(stream.device)  # a recording cannot allocate memory
    with own_scratch(scratch), _streams.only_stream(stream):
        with wp.ScopedCapture(stream=stream) as captured:
            call()

    def launch_graph() -> None:
        wp.capture_launch(captured.graph, stream=_streams.current_stream(stream.device))

    # Keep the memory alive that the graph addresses.
    launch_graph.kept = call, scratch  # pyright: ignore[reportFunctionMemberAccess]
    return launch_graph


def _carried(dtype: np.dtype) -> Any:
    return wp.uint8 if dtype == np.bool_ else wp.dtype_from_numpy(dtype)
