"""Device arrays for Taichi's CUDA kernels: Warp's arrays, passed to Taichi as addresses.

Taichi and Warp both work in the primary context of the first GPU. Taichi's launcher accepts any
address of that GPU's memory, so it only needs a NumPy header with this address.
"""

from typing import Any

import numpy as np
import warp as wp

wp.config.log_level = wp.LOG_ERROR
wp.init()

DEVICE = "cuda:0"  # Taichi drives the first GPU that CUDA lists


def upload(array: np.ndarray, shape: tuple[int, ...]) -> wp.array:
    """Copy a contiguous host array to the device, bool as uint8."""
    host = (array.view(np.uint8) if array.dtype == np.bool_ else array).reshape(shape)
    return wp.array(host, dtype=wp.dtype_from_numpy(host.dtype), device=DEVICE)


def view(
    address: int, owner: Any, dtype: np.dtype, shape: tuple[int, ...], device: str = DEVICE
) -> wp.array:
    """View the memory of `owner`, contiguous at `address`, bool as uint8."""
    scalar = wp.uint8 if dtype == np.bool_ else wp.dtype_from_numpy(dtype)
    if isinstance(owner, wp.array) and owner.dtype is scalar and tuple(owner.shape) == shape:
        return owner
    array = wp.array(ptr=address, dtype=scalar, shape=shape, device=device)
    array.owner = owner  # keeps the memory alive
    return array


def empty(shape: tuple[int, ...], dtype: np.dtype) -> wp.array:
    """Allocate an uninitialised array."""
    scalar = wp.bool if dtype == np.bool_ else wp.dtype_from_numpy(dtype)
    return wp.empty(shape, dtype=scalar, device=DEVICE)


def free_memory() -> int:
    """Return the number of free bytes on the device."""
    return wp.get_device(DEVICE).free_memory


def fill(array: wp.array, values: np.ndarray) -> None:
    """Copy a contiguous host array into `array`; wait for it."""
    wp.copy(array, upload(values, tuple(array.shape)))
    wp.synchronize_stream(array.device.stream)


def header(array: wp.array) -> np.ndarray:
    """Return a NumPy array with the address of `array`; only Taichi may read or write it."""
    dtype = np.dtype(wp.dtype_to_numpy(array.dtype))
    if array.size == 0:
        return np.empty(tuple(array.shape), dtype)
    return np.asarray(_Interface(array, dtype))


class _Interface:
    """NumPy's array interface of a contiguous Warp array, which it keeps alive."""

    def __init__(self, array: wp.array, dtype: np.dtype) -> None:
        self.array = array
        self.__array_interface__ = {
            "version": 3,
            "shape": tuple(array.shape),
            "typestr": dtype.str,
            "data": (int(array.ptr), False),  # a slice with NumPy's bounds has a NumPy integer here
        }
