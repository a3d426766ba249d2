"""The array libraries of callers, one class each.

A library is recognised by the module of an array's type, and imported when cvkern gets an array.
"""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from enum import Enum
from typing import Any

import numpy as np

from cvkern._memory import empty

CUDA, CUDA_MANAGED = 2, 13  # device types of DLPack


class Order(Enum):
    """How kernels on a GPU wait for the work that fills an array of a library."""

    STREAM = "kernels are launched on the library's current stream"
    DLPACK = "the array is handed over by DLPack, which makes the kernels' stream wait"


class Library(ABC):
    """An array library: the place of its arrays, and the few operations that cvkern needs.

    The methods with a body suit libraries whose `module` has NumPy's names.
    """

    writable = True  # whether kernels may fill its arrays
    order = Order.STREAM
    module: Any

    def dtype(self, array: Any) -> np.dtype:
        """Return the NumPy dtype of `array`."""
        return array.dtype

    @abstractmethod
    def device(self, array: Any) -> str:
        """Return where `array` lives: ``"cpu"``, or ``"cuda:N"``."""

    @abstractmethod
    def memory(self, array: Any, device: str) -> tuple[int, Any]:
        """Return the address of a contiguous array on `device`, and the object that owns it."""

    @abstractmethod
    def contiguous(self, array: Any, dtype: np.dtype) -> Any:
        """Return `array` in C order, native byte order and `dtype`, without a copy if it can."""

    def empty(self, shape: tuple[int, ...], dtype: np.dtype, device: str) -> Any:
        """Allocate an uninitialised array on `device`; on the host if it is not `writable`."""
        return empty(shape, dtype)

    def stream(self, device: str) -> int | None:
        """Return the caller's current CUDA stream, or None where the library has none."""
        return None

    def native(self, array: Any) -> Any:
        """Return `array` in the byte order of this machine."""
        return array

    def finish(self, array: Any) -> Any:
        """Convert an array that a kernel set filled into the library's own."""
        return array

    def fill(self, out: Any, values: Any) -> None:
        """Copy `values` into an array of the library."""
        out[...] = values

    def view(self, array: Any, dtype: np.dtype) -> Any:
        """Read the bits of a contiguous array as another dtype of the same size."""
        return array.view(dtype)

    def swap(self, array: Any) -> Any:
        """Exchange the last two axes of an array."""
        return array.swapaxes(-1, -2)

    def last(self, array: Any, axis: int) -> Any:
        """Move an axis to the end."""
        return self.module.moveaxis(array, axis, -1)

    def join(self, arrays: list[Any]) -> Any:
        """Return arrays of one dtype, one after the other; None if the library cannot."""
        return getattr(getattr(self, "module", None), "concatenate", lambda _: None)(arrays)

    def ranks(self, array: Any, extra: float) -> tuple[Any, Any, int]:
        """Return the sorted distinct values of `array` and `extra`, and the index of each."""
        flat = array.reshape(-1)
        last = self.module.full_like(flat[:1], extra)
        values, ranks = self.module.unique(
            self.module.concatenate((flat, last)), return_inverse=True
        )
        return values, ranks[:-1].reshape(array.shape), int(ranks[-1])


class NumPy(Library):
    """NumPy, and everything NumPy can read: lists, pictures, CPU arrays of unknown libraries."""

    module = np

    def device(self, array: Any) -> str:
        """Return ``"cpu"``."""
        return "cpu"

    def memory(self, array: Any, device: str) -> tuple[int, Any]:
        """Read the address from NumPy's interface."""
        return array.__array_interface__["data"][0], array

    def contiguous(self, array: Any, dtype: np.dtype) -> Any:
        """Convert; values beyond the range of a smaller float become infinite."""
        array = np.asarray(array)
        if array.dtype is not dtype and array.dtype.kind == "f":
            with np.errstate(over="ignore"):
                return np.ascontiguousarray(array, dtype)
        return np.ascontiguousarray(array, dtype)

    def native(self, array: Any) -> Any:
        """Swap the bytes of an array of the other order."""
        return array if array.dtype.isnative else array.astype(array.dtype.newbyteorder("="))


class Torch(Library):
    """PyTorch tensors."""

    def __init__(self) -> None:
        self.module = importlib.import_module("torch")
        self._dtypes: dict[Any, Any] = {}  # torch's of NumPy's, and NumPy's of torch's

    def dtype(self, array: Any) -> np.dtype:
        """Return the NumPy dtype of `array`; bfloat16, which NumPy lacks, counts as float32."""
        if array.dtype not in self._dtypes:
            name = str(array.dtype).removeprefix("torch.")
            self._dtypes[array.dtype] = np.dtype("float32" if name == "bfloat16" else name)
        return self._dtypes[array.dtype]

    def device(self, array: Any) -> str:
        """Return where `array` lives: ``"cpu"``, or ``"cuda:N"``."""
        return str(array.device)

    def memory(self, array: Any, device: str) -> tuple[int, Any]:
        """Ask the tensor for its pointer, which is faster than its interface."""
        if array.is_cuda == (device == "cpu"):
            _refuse_places(device, str(array.device))
        return array.data_ptr(), array

    def stream(self, device: str) -> int | None:
        """Return the current stream of this thread."""
        return self.module.cuda.current_stream(_index(device)).cuda_stream

    def contiguous(self, array: Any, dtype: np.dtype) -> Any:
        """Convert on the tensor's own device."""
        if array.requires_grad:
            raise TypeError("tensors must not require grad, got one that does: call .detach()")
        wanted = self._dtype(dtype)
        if array.dtype is wanted and array.is_contiguous() and not array.is_neg():
            return array
        return array.to(wanted).contiguous().resolve_neg()

    def empty(self, shape: tuple[int, ...], dtype: np.dtype, device: str) -> Any:
        """Allocate with PyTorch's caching allocator."""
        return self.module.empty(shape, dtype=self._dtype(dtype), device=device)

    def view(self, array: Any, dtype: np.dtype) -> Any:
        """Read the bits of a contiguous tensor as another dtype of the same size."""
        return array.view(self._dtype(dtype))

    def _dtype(self, dtype: np.dtype) -> Any:
        if dtype not in self._dtypes:
            self._dtypes[dtype] = getattr(self.module, dtype.name)
        return self._dtypes[dtype]


class CuPy(Library):
    """CuPy arrays."""

    def __init__(self) -> None:
        self.module = importlib.import_module("cupy")

    def device(self, array: Any) -> str:
        """Return ``"cuda:N"``."""
        return f"cuda:{array.device.id}"

    def memory(self, array: Any, device: str) -> tuple[int, Any]:
        """Ask the array for its pointer."""
        if device == "cpu":
            _refuse_places(device, self.device(array))
        return array.data.ptr, array

    def stream(self, device: str) -> int | None:
        """Return the current stream of this thread."""
        with self.module.cuda.Device(_index(device)):
            return self.module.cuda.get_current_stream().ptr

    def contiguous(self, array: Any, dtype: np.dtype) -> Any:
        """Convert on the array's own device."""
        with array.device:
            return self.module.ascontiguousarray(array, dtype)

    def join(self, arrays: list[Any]) -> Any:
        """Join them on their device."""
        with arrays[0].device:
            return self.module.concatenate(arrays)

    def empty(self, shape: tuple[int, ...], dtype: np.dtype, device: str) -> Any:
        """Allocate from CuPy's memory pool."""
        with self.module.cuda.Device(_index(device)):
            return self.module.empty(shape, dtype)


class Warp(Library):
    """Warp arrays."""

    def __init__(self) -> None:
        self.module = importlib.import_module("warp")

    def dtype(self, array: Any) -> np.dtype:
        """Return the dtype of an array of scalars; refuse vectors and matrices."""
        if self.module.types.type_is_vector(array.dtype) or self.module.types.type_is_matrix(
            array.dtype
        ):
            raise TypeError(f"Warp arrays must hold scalars, got {array.dtype.__name__}")
        return np.dtype(self.module.dtype_to_numpy(array.dtype))

    def device(self, array: Any) -> str:
        """Return ``"cpu"`` or ``"cuda:N"``, as Warp names devices."""
        return array.device.alias

    def memory(self, array: Any, device: str) -> tuple[int, Any]:
        """Ask the array for its pointer."""
        if array.device.alias != device:
            _refuse_places(device, array.device.alias)
        return array.ptr or 0, array

    def stream(self, device: str) -> int | None:
        """Return Warp's current stream of the device."""
        return self.module.get_stream(device).cuda_stream

    def contiguous(self, array: Any, dtype: np.dtype) -> Any:
        """Convert on the array's own device."""
        wanted = self._carried(dtype)
        if array.dtype is not wanted:
            cast = self.module.empty(array.shape, dtype=wanted, device=array.device)
            self.module.utils.array_cast(array.contiguous(), cast)
            return cast
        return array if array.is_contiguous else array.contiguous()

    def empty(self, shape: tuple[int, ...], dtype: np.dtype, device: str) -> Any:
        """Allocate with Warp."""
        return self.module.empty(shape, dtype=self._carried(dtype), device=device)

    def fill(self, out: Any, values: Any) -> None:
        """Copy `values` into a Warp array."""
        self.module.copy(out, values)

    def view(self, array: Any, dtype: np.dtype) -> Any:
        """Read the bits of an array as another dtype of the same size."""
        return array.view(self._carried(dtype))

    def swap(self, array: Any) -> Any:
        """Exchange the last two axes of an array."""
        last = array.ndim - 1
        return array.transpose((*range(last - 1), last, last - 1))

    def last(self, array: Any, axis: int) -> Any:
        """Move an axis to the end."""
        return array.transpose((*(i for i in range(array.ndim) if i != axis), axis))

    def ranks(self, array: Any, extra: float) -> tuple[Any, Any, int]:
        """Refuse: Warp has no sorted search for such values."""
        raise TypeError(f"Warp arrays must be of at most 32 bits, signed, got {array.dtype}")

    def _carried(self, dtype: np.dtype) -> Any:
        return self.module.bool if dtype == np.bool_ else self.module.dtype_from_numpy(dtype)


class Jax(Library):
    """JAX arrays. They are immutable, so results are allocated elsewhere and passed by DLPack."""

    writable = False
    order = Order.DLPACK

    def __init__(self) -> None:
        self.module = importlib.import_module("jax.numpy")

    def device(self, array: Any) -> str:
        """Return where `array` lives: ``"cpu"``, or ``"cuda:N"``."""
        return _dlpack_device(array)

    def memory(self, array: Any, device: str) -> tuple[int, Any]:
        """View an array of the host with NumPy, and an array of a GPU through DLPack."""
        if self.device(array) != "cpu":
            _refuse_places(device, self.device(array))
        host = np.asarray(array)
        return host.__array_interface__["data"][0], host

    def contiguous(self, array: Any, dtype: np.dtype) -> Any:
        """Convert on the array's own device; JAX arrays are contiguous."""
        return array.astype(dtype)

    def finish(self, array: Any) -> Any:
        """Pass the memory to JAX, without a copy where JAX accepts it."""
        return self.module.from_dlpack(array)


class Other(Library):
    """CUDA arrays of any other library that has ``__cuda_array_interface__``.

    Their results are Warp arrays, which support this interface and DLPack.
    """

    writable = False

    def dtype(self, array: Any) -> np.dtype:
        """Read the dtype from the interface."""
        return np.dtype(array.__cuda_array_interface__["typestr"])

    def device(self, array: Any) -> str:
        """Return ``"cuda:N"``, or the first GPU if the interface does not name one."""
        return _dlpack_device(array) if hasattr(array, "__dlpack_device__") else "cuda:0"

    def memory(self, array: Any, device: str) -> tuple[int, Any]:
        """Read the address from the interface."""
        if device == "cpu":
            _refuse_places(device, self.device(array))
        return int(array.__cuda_array_interface__["data"][0] or 0), array

    def contiguous(self, array: Any, dtype: np.dtype) -> Any:
        """Refuse an array that only its own library could convert."""
        interface = array.__cuda_array_interface__
        if np.dtype(interface["typestr"]) != dtype or interface.get("strides") is not None:
            raise TypeError(
                f"CUDA arrays of {type(array).__module__} must be contiguous {dtype.name}, "
                f"got {interface['typestr']} with strides {interface.get('strides')}"
            )
        return array

    def last(self, array: Any, axis: int) -> Any:
        """Refuse to move an axis, which only the array's own library could do."""
        raise TypeError(f"channel_axis must be the last one for {type(array).__module__} arrays")


NUMPY = NumPy()
_CLASSES = {"torch": Torch, "cupy": CuPy, "warp": Warp, "jax": Jax, "jaxlib": Jax}
_known: dict[str, Library] = {}
_of_types: dict[type, Library] = {}


def library(array: Any, name: str = "arrays") -> Library:
    """Return the library that `array`, an argument called `name`, belongs to.

    Raises
    ------
    TypeError
        If it is a masked array, or a placeholder without values (as inside ``jax.jit``).
    """
    kind = type(array)
    if kind is np.ndarray:
        return NUMPY
    return _of_types.get(kind) or _find(array, kind, name)


def _find(array: Any, kind: type, name: str) -> Library:
    if isinstance(array, np.ma.MaskedArray):
        raise TypeError(f"{name} must not be masked, got {kind.__name__}: pass array.filled(value)")
    for base in kind.__mro__:  # a subclass may come from any module
        module = base.__module__.partition(".")[0]
        if module not in _CLASSES:
            continue
        if any(parent.__name__ == "Tracer" for parent in kind.__mro__):
            raise TypeError(
                f"{name} must have values, got {kind.__name__}: "
                "call cvkern outside of jax.jit and of JAX's other transformations"
            )
        module = "jax" if module == "jaxlib" else module
        _known[module] = _known.get(module) or _CLASSES[module]()
        return _of_types.setdefault(kind, _known[module])
    if hasattr(array, "__cuda_array_interface__"):
        return _known.setdefault("other", Other())
    return NUMPY


def device(array: Any) -> str:
    """Return where `array` lives: ``"cpu"``, or ``"cuda:N"``."""
    return library(array).device(array)


def _refuse_places(*places: str) -> None:
    raise ValueError(f"arrays must be on one device, got {', '.join(sorted(places))}")


def _dlpack_device(array: Any) -> str:
    kind, index = array.__dlpack_device__()
    return f"cuda:{int(index)}" if kind in (CUDA, CUDA_MANAGED) else "cpu"


def _index(device: str) -> int:
    return int(device.partition(":")[2] or 0)
