"""Copies on devices of host arrays that never change."""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np

from cvkern._runtime import Runtime

_Key = tuple[str, str, int]

_kept: dict[_Key, Any] = {}
_stale: list[Any] = []  # copies that kernels which still run may use


def kept(rt: Runtime, array: np.ndarray) -> Any:
    """View a host array that never changes for kernels; a GPU keeps its copy while it lives."""
    if rt.device == "cpu":
        return rt.adopt(array, array.dtype)
    key = (rt.name, rt.device, id(array))
    found = _kept.get(key)
    if found is None:
        found = _kept[key] = rt.adopt(array, array.dtype)
        weakref.finalize(array, _forget, key).atexit = False
        if _stale:
            rt.to_numpy(found)  # wait
            _stale.clear()
    return found


def _forget(key: _Key) -> None:
    copy = _kept.pop(key, None)
    if copy is not None:
        _stale.append(copy)
