"""The Warp kernel set: arrays and streams here, primitives in the modules of this folder."""

from __future__ import annotations

import math
import os
import tempfile
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from . import _launch, _pages

_LINE = 64  # bytes of a line of the cache: rows of as many should not lie across two

_streams: dict[tuple[str, int | None], wp.Stream | None] = {}
_process = 0
_lock = threading.Lock()


def start(device: str, stream: int | None) -> None:
    """Initialise Warp, check that `device` exists, send this thread's launches to `stream`."""
    global _process
    if not _process:
        with _lock:
            if not _process:
                _initialise()
                _process = os.getpid()
    if device == "cpu":
        _launch.set_stream(None)
        return
    if _process != os.getpid():
        raise RuntimeError(
            "CUDA cannot be used in a forked process: start workers with the 'spawn' method"
        )
    key = (device, stream)
    if key not in _streams:
        if not wp.is_device_available(device):
            names = tuple(d.alias for d in wp.get_devices())
            raise ValueError(f"device must be one that Warp finds here, {names}, got {device!r}")
        _streams[key] = None if stream is None else wp.Stream(device, cuda_stream=stream)
    _launch.set_stream(_streams[key])


def _initialise() -> None:
    """Start Warp without its notice, native and on stderr, that a machine has no GPU."""
    wp.config.log_level = wp.LOG_ERROR
    with tempfile.TemporaryFile() as said:
        stderr = os.dup(2)
        os.dup2(said.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
        said.seek(0)
        lines = said.read().splitlines(keepends=True)
    kept = b"".join(line for line in lines if b"NVIDIA CUDA driver" not in line)
    if kept:
        os.write(2, kept)


def adopt(array: Any, dtype: np.dtype, shape: tuple[int, ...], device: str) -> wp.array:
    """View a contiguous array for kernels, bool as uint8; NumPy goes to a CUDA device by copy."""
    if isinstance(array, wp.array):
        address = array.ptr
    elif hasattr(array, "data_ptr") and array.is_cuda == (device != "cpu"):
        address = array.data_ptr()  # torch, whose interface below takes longer
    elif device == "cpu":
        array = np.asarray(array)
        address = array.ctypes.data
    elif isinstance(array, np.ndarray):
        array = wp.array(array, device=device)
        wp.synchronize_stream(array.device.stream)  # the kernels may run on another stream
        address = array.ptr
    elif hasattr(array, "__cuda_array_interface__") and not hasattr(array, "at"):
        address = array.__cuda_array_interface__["data"][0]
    else:
        array = wp.from_dlpack(array)  # JAX: DLPack also orders the two streams
        address = array.ptr
    carried = _carried(dtype)
    if isinstance(array, wp.array) and array.dtype is carried and array.shape == shape:
        return array
    view = _launch.view_at(address, carried, shape, wp.get_device(device))
    view.owner = array  # pyright: ignore[reportAttributeAccessIssue]  (keeps the memory alive)
    return view


def empty(shape: tuple[int, ...], dtype: np.dtype, device: str) -> wp.array:
    """Allocate an uninitialised array."""
    scalar = wp.bool if dtype == np.bool_ else wp.dtype_from_numpy(dtype)
    return wp.empty(shape, dtype=scalar, device=device)


def zeros(shape: tuple[int, ...], dtype: np.dtype, device: str) -> wp.array:
    """Allocate an array of 0; on the CPU of pages that take no time until they are written."""
    if device == "cpu":
        size = math.prod(shape) * dtype.itemsize
        room = np.zeros(size + _LINE, np.uint8)
        begin = -room.ctypes.data % _LINE
        return adopt(room[begin : begin + size].view(dtype), dtype, shape, device)
    array = empty(shape, dtype, device)
    clear(array)
    return array


def scratch(name: str, shape: tuple[int, ...], dtype: np.dtype, device: str) -> wp.array:
    """Return memory that stays valid until this thread asks for `name` again."""
    return _launch.scratch(name, shape, _carried(dtype), wp.get_device(device))


def write(array: wp.array, values: np.ndarray) -> None:
    """Copy contiguous host values of its shape and dtype into `array`; wait for that on CUDA."""
    host = adopt(values, values.dtype, values.shape, "cpu")
    stream = _launch.current_stream(array.device) if array.device.is_cuda else None
    wp.copy(array, host, stream=stream)
    if stream:
        wp.synchronize_stream(stream)


def clear(array: wp.array) -> None:
    """Fill `array` with 0, in order with the kernels."""
    if array.device.is_cuda:
        # To wait for Warp's own stream here, its default, is what no graph could record.
        with wp.ScopedStream(_launch.current_stream(array.device), sync_enter=False):
            array.zero_()
    else:
        array.zero_()


def to_numpy(array: wp.array) -> np.ndarray:
    """Wait for the kernels that fill `array`, then bring it to the host (a view on the CPU)."""
    if not array.device.is_cuda:
        return array.numpy()
    stream = _launch.current_stream(array.device)
    found = _pages.empty(array.shape, np.dtype(wp.dtype_to_numpy(array.dtype)))
    if found.nbytes > _launch.PAGE:
        wp.copy(adopt(found, found.dtype, found.shape, "cpu"), array, stream=stream)
        wp.synchronize_stream(stream)
    else:
        page = _launch.page(array.dtype, array.shape)
        wp.copy(page, array, stream=stream)
        wp.synchronize_stream(stream)
        found[...] = page.numpy()
    return found


def free_memory(device: str) -> int:
    """Return how many bytes a GPU has left."""
    return wp.get_device(device).free_memory


own_scratch = _launch.own_scratch
MATRIX_DTYPES = {"cpu": "float32", "cuda": "float16"}


def record(call: Callable[[], None], device: str) -> Callable[[], None]:
    """Return what repeats the launches of `call`: one launch of a graph on CUDA."""
    if device == "cpu":
        return call
    stream = wp.Stream(device)  # the legacy default stream, where torch works, cannot record
    scratch = _launch.known_scratch(stream.device)  # nothing can be allocated in a recording
    with own_scratch(scratch), _launch.only_stream(stream):
        with wp.ScopedCapture(stream=stream) as captured:
            call()

    def launch_graph() -> None:
        wp.capture_launch(captured.graph, stream=_launch.current_stream(stream.device))

    # Keeps alive the memory that the graph addresses.
    launch_graph.kept = call, scratch  # pyright: ignore[reportFunctionMemberAccess]
    return launch_graph


def _carried(dtype: np.dtype) -> Any:
    return wp.uint8 if dtype == np.bool_ else wp.dtype_from_numpy(dtype)
