"""Calls on arrays of a GPU, or on small ones of NumPy, that are repeated by their launches alone.

The second call with the same options, on an array of the same shape and dtype, notes its launches.
Later calls allocate the results, and send these launches again with other addresses. They skip the
checks and the choices on the way.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numpy as np

from cvkern._arrays import Library, library
from cvkern._runtime import choice, runtime
from cvkern._tape import capturing, taped

P = ParamSpec("P")
R = TypeVar("R")
_MOST = 128  # plans that a thread keeps
_ALIGNED = 256  # bytes: kernels may choose by the alignment of an array
_SMALL = 1 << 16  # elements up to which one thread of the CPU does all the work
_DTYPES = (np.dtype(np.float32), np.dtype(np.uint8))  # others may be converted by their library
_PLAIN = frozenset((int, float, str, bool, type(None), type))  # types of options that are keys


class _Thread(threading.local):
    """The plans of a thread: 1 after the first call, then a plan, or False if none is exact."""

    def __init__(self) -> None:
        self.plans: dict[Any, Any] = {}


_thread = _Thread()


class _Repeat:
    """The launches of a call, and the kinds of its results."""

    def __init__(self, plan: Any, lib: Library, device: str, results: list[Any], kind: Any):
        self._plan, self._lib, self._device, self._kind = plan, lib, device, kind
        self._results = [(tuple(a.shape), lib.dtype(a)) for a in results]
        self.valid = plan.valid

    def __call__(self, image: Any) -> Any:
        lib, device = self._lib, self._device
        arrays = [lib.empty(*result, device) for result in self._results]
        self._plan.launch([lib.memory(a, device)[0] for a in (image, *arrays)])
        return arrays[0] if self._kind is None else self._kind(*arrays)


def planned(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function repeat its launches; its first argument is the only array that it reads."""

    @functools.wraps(function)
    def quick(*args: P.args, **options: P.kwargs) -> R:
        place = _place_of(args[0]) if args else None
        given = (*args[1:], *options.values())
        kinds = tuple(map(_kind, given))
        if place is None or not _plain(kinds) or choice()[0] != "warp" or capturing():
            return function(*args, **options)
        key = (function, place, given, kinds, tuple(options))
        plans = _thread.plans
        known = plans.get(key)
        if isinstance(known, _Repeat) and known.valid():
            return known(args[0])
        if known is False:
            return function(*args, **options)
        while len(plans) >= _MOST:
            plans.pop(next(iter(plans)))
        if known is None:
            plans[key] = 1  # the first call loads modules, and allocates scratch memory
            return function(*args, **options)
        result, plans[key] = _noted(function, args, options)
        return result

    return quick


def planned_on_gpus(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function repeat its launches, unless NumPy's arrays give it more to do than these."""
    quick = planned(function)

    @functools.wraps(function)
    def either(*args: P.args, **options: P.kwargs) -> R:
        host = bool(args) and isinstance(args[0], np.ndarray)
        return (function if host else quick)(*args, **options)

    return either


def forget() -> None:
    """Forget the plans of this thread, and so the memory that they keep."""
    _thread.plans.clear()


def _kind(option: Any) -> Any:
    """Return the type of an option, because 1 and True are equal; of a tuple, those in it."""
    kind = type(option)
    return tuple(map(type, option)) if kind is tuple else kind


def _plain(kinds: tuple[Any, ...]) -> bool:
    """Tell whether values of these kinds can be keys."""
    return all(_PLAIN.issuperset(k) if type(k) is tuple else k in _PLAIN for k in kinds)


def _place_of(image: Any) -> Any:
    """Return the properties that decide the launches of a call: shape, dtype, device and stream.

    Return None if `image` is neither a tensor on a GPU nor a small array of NumPy that kernels take
    as it is.
    """
    if type(image) is np.ndarray:
        flags = image.flags
        plain = image.size <= _SMALL and image.dtype in _DTYPES and flags.c_contiguous
        if not plain or not flags.aligned or choice()[1] != "cpu":
            return None
        return image.shape, image.dtype, "cpu"
    if type(image).__module__ != "torch" or not image.is_cuda:
        return None
    if image.requires_grad or not image.is_contiguous() or image.is_neg():
        return None
    lib, device = library(image), str(image.device)
    dtype = lib.dtype(image)
    if dtype not in _DTYPES or lib.memory(image, device)[0] % _ALIGNED:
        return None
    return tuple(image.shape), dtype, device, lib.stream(device)


def _noted(function: Callable[..., Any], args: Any, options: Any) -> tuple[Any, Any]:
    """Return the result of a call, and its repetition, or False if it cannot be repeated."""
    image = args[0]
    results: list[Any] = []
    try:
        with taped(results, []):
            result, plan = runtime(image).plan(lambda: function(*args, **options), image, results)
    except ValueError:  # a call that needs the host
        return function(*args, **options), False
    named = hasattr(result, "_fields")
    whole = list(result) if named else [result]
    same = len(whole) == len(results) and all(a is b for a, b in zip(whole, results, strict=True))
    if plan is None or not same:
        return result, False
    lib = library(image)
    return result, _Repeat(plan, lib, lib.device(image), results, type(result) if named else None)
