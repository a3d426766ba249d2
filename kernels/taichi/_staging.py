"""Kernels on GPUs that Taichi reaches through Vulkan or Metal, with arrays of the host.

Taichi copies an array of the host to such a GPU only if a kernel reads it, so what a kernel does
not write would be lost. Here the arrays of a primitive are Taichi's own while it runs: they are
copied to the GPU when a kernel first takes them, and what has changed is copied back at the end.
"""

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import taichi as ti
from taichi.lang import kernel_impl
from taichi.lang.util import to_taichi_type

# Kernels whose results were wrong with Vulkan on an NVIDIA GPU.
WRONG = {"cvkern.kernels.taichi.features.keypoints.descriptors": "descriptors of SIFT"}

_stages: list["Stage"] = []  # the stage of the primitive that runs


class Stage:
    """The arrays of one primitive on the GPU."""

    def __init__(self) -> None:
        self._held: dict[Any, tuple[np.ndarray, Any]] = {}
        self._scratch: list[np.ndarray] = []
        self._copies = False

    def scratch(self, shape: tuple[int, ...], dtype: Any) -> np.ndarray:
        """Return an array that only the kernels of this primitive use."""
        array = np.empty(shape, dtype)
        self._scratch.append(array)
        return array

    def call(self, run: Callable[..., Any], kernel: Any, *args: Any, **kwargs: Any) -> Any:
        """Run a kernel, with arrays of the GPU in place of the host's."""
        if self._copies:
            return run(kernel, *args, **kwargs)
        given = [self._there(a) for a in args]
        return run(kernel, *given, **{name: self._there(a) for name, a in kwargs.items()})

    def finish(self) -> None:
        """Copy what has changed back to the host."""
        for array, there in self._held.values():
            self._take(array, there)
        self._held.clear()

    def _there(self, array: Any) -> Any:
        if not isinstance(array, np.ndarray) or not array.size:
            return array
        key = (array.ctypes.data, array.shape, array.dtype.str)
        held = self._held.get(key)
        if held is not None:
            return held[1]
        known = any(_overlap(array, other) for other in self._scratch)
        for other_key, (other, there) in list(self._held.items()):
            if _overlap(array, other):  # the same memory in another shape
                self._take(other, there, known)
                del self._held[other_key]
                known = False
        there = ti.ndarray(to_taichi_type(array.dtype), array.shape)
        if not known:  # scratch begins with anything
            with self._copying():
                there.from_numpy(array)
        self._held[key] = array, there
        return there

    def _take(self, array: np.ndarray, there: Any, always: bool = False) -> None:
        is_scratch = any(_overlap(array, other) for other in self._scratch)
        if (is_scratch and not always) or not array.flags.writeable:
            return
        with self._copying():
            values = there.to_numpy()
        # Bits are compared, and an input is not written to, so that others may read it meanwhile.
        if values.tobytes() != array.tobytes():
            array[...] = values

    @contextlib.contextmanager
    def _copying(self) -> Iterator[None]:
        self._copies = True
        try:
            yield
        finally:
            self._copies = False


@ti.kernel
def _count(
    number: ti.i32,
    # outputs
    sums: ti.types.ndarray(dtype=ti.i32, ndim=1),
):
    for i in range(number):
        for k in range(sums.shape[0]):
            ti.atomic_add(sums[(i + k) % sums.shape[0]], 1)


def check(device: str) -> None:
    """Refuse a driver that loses turns of loops, as Mesa's lavapipe 22.3 does."""
    number, sums = 1000, np.zeros(97, np.int32)
    launch(_count, (number, sums), {})
    if (sums != number).any():
        raise RuntimeError(
            f"device {device!r} has a driver that computes loops wrongly: {sums.min()} of "
            f"{number} counts; update the driver, or use another device"
        )


def stage() -> Stage:
    """Return the stage of the primitive that runs."""
    return _stages[-1]


def launch(primitive: Callable[..., None], args: tuple, kwargs: dict[str, Any]) -> None:
    """Run a primitive on arrays of the host; Taichi's lock must be held."""
    if primitive.__module__ in WRONG:
        raise RuntimeError(
            f"device must be 'cpu' or 'cuda' for {WRONG[primitive.__module__]}, "
            "which Vulkan computed wrongly"
        )
    if _stages:  # a primitive that another one is made of
        primitive(*args, **kwargs)
        return
    run, here = kernel_impl.Kernel.__call__, Stage()
    _stages.append(here)
    kernel_impl.Kernel.__call__ = lambda kernel, *a, **k: here.call(run, kernel, *a, **k)
    try:
        primitive(*args, **kwargs)
        here.finish()
    except RuntimeError as error:
        if "spirv_codegen" in str(error):
            raise RuntimeError(
                "device must be one with functions of float64, such as sines, which Vulkan and "
                "Metal lack: use 'cpu' or 'cuda'"
            ) from error
        raise
    finally:
        kernel_impl.Kernel.__call__ = run
        _stages.pop()


def _overlap(one: np.ndarray, other: np.ndarray) -> bool:
    first, second = one.ctypes.data, other.ctypes.data
    return first < second + other.nbytes and second < first + one.nbytes
