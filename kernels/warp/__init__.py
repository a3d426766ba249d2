"""The Warp kernel set: arrays and streams here, primitives in the modules of this folder."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import warp as wp

from . import _launch

_streams: dict[tuple[str, int], wp.Stream] = {}
_process = 0


def start(device: str, stream: int | None) -> None:
    """Initialise Warp, check that `device` exists, send this thread's launches to `stream`."""
    global _process
    if not _process:
        wp.config.log_level = wp.LOG_ERROR
        wp.init()
        _process = os.getpid()
    if device == "cpu":
        _launch.set_stream(None)
        return
    if _process != os.getpid():
        raise RuntimeError(
            "CUDA cannot be used in a forked process: start workers with the 'spawn' method"
        )
    if not wp.is_device_available(device):
        names = tuple(d.alias for d in wp.get_devices())
        raise ValueError(f"device must be one that Warp finds here, {names}, got {device!r}")
    if stream is None:
        _launch.set_stream(None)
        return
    key = (device, stream)
    if key not in _streams:
        _streams[key] = wp.Stream(device, cuda_stream=stream)
    _launch.set_stream(_streams[key])


def adopt(array: Any, device: str) -> wp.array:
    """View a contiguous array for kernels, bool as uint8; NumPy goes to a CUDA device by copy."""
    if isinstance(array, np.ndarray):
        if array.dtype == np.bool_:
            array = array.view(np.uint8)
        if device == "cpu":
            return _view(array, array.ctypes.data, array.dtype, array.shape, device)
        return wp.array(array, dtype=wp.dtype_from_numpy(array.dtype), device=device)
    if isinstance(array, wp.array):
        if array.dtype is not wp.bool:
            return array
        return _view(array, array.ptr, np.uint8, array.shape, device)
    if hasattr(array, "__cuda_array_interface__") and not hasattr(array, "at"):
        face = array.__cuda_array_interface__
        return _view(array, face["data"][0], np.dtype(face["typestr"]), face["shape"], device)
    return adopt(wp.from_dlpack(array), device)  # JAX: DLPack also orders the two streams


def empty(shape: tuple[int, ...], dtype: np.dtype, device: str) -> wp.array:
    """Allocate an uninitialised array."""
    return wp.empty(shape, dtype=_scalar(dtype), device=device)


def scratch(name: str, shape: tuple[int, ...], dtype: np.dtype, device: str) -> wp.array:
    """Return memory that stays valid until this thread asks for `name` again."""
    carried = wp.uint8 if dtype == np.bool_ else _scalar(dtype)
    return _launch.scratch(name, shape, carried, wp.get_device(device))


def to_numpy(array: wp.array) -> np.ndarray:
    """Wait for the kernels that fill `array`, then bring it to the host (a view on the CPU)."""
    if array.device.is_cuda:
        wp.synchronize_stream(_launch.current_stream(array.device))
    return array.numpy()


def _view(owner: Any, address: int, dtype: Any, shape: tuple[int, ...], device: str) -> wp.array:
    dtype = np.dtype(dtype)
    carried = wp.uint8 if dtype == np.bool_ else _scalar(dtype)
    view = wp.array(ptr=address, dtype=carried, shape=shape, device=device)
    view.owner = owner  # pyright: ignore[reportAttributeAccessIssue]  (keeps the memory alive)
    return view


def _scalar(dtype: np.dtype) -> Any:
    return wp.bool if dtype == np.bool_ else wp.dtype_from_numpy(dtype)
