"""Shortcuts through Warp's private parts, each with a plain fallback.

Two steps in Warp's Python take longer than a small kernel runs: making an array that views memory,
and packing the arguments of a launch. Compiling for the CPU begins with two seconds for Warp's own
headers, in each process and thread. The quick ways below depend on Warp's internals. They are
used with the versions that they were tested with. A newer Warp gets the plain ways, which use the
documented interface and give the same results more slowly.
"""

from __future__ import annotations

import hashlib
import re
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import warp as wp

TESTED = (1, 19)  # the newest minor version of Warp that the quick ways were tested with
_MAX_LAYOUTS = 512

_layouts: dict[Any, wp.array] = {}


def _quick() -> bool:
    """Tell whether the quick ways were tested with this version of Warp."""
    version = re.match(r"(\d+)\.(\d+)", wp.__version__)
    return version is not None and (int(version[1]), int(version[2])) <= TESTED


QUICK = _quick()


def _plain_view_at(
    address: int | None,
    dtype: Any,
    shape: tuple[int, ...],
    device: wp.Device,
    strides: tuple[int, ...] | None = None,
) -> wp.array:
    """View the memory at an address, without keeping it alive."""
    return wp.array(ptr=address or 0, dtype=dtype, shape=shape, strides=strides, device=device)


def _quick_view_at(
    address: int | None,
    dtype: Any,
    shape: tuple[int, ...],
    device: wp.Device,
    strides: tuple[int, ...] | None = None,
) -> wp.array:
    """View the memory at an address, without keeping it alive, by copying an array object."""
    key = (dtype, shape, device.alias, strides)
    layout = _layouts.get(key)
    if layout is None:
        if len(_layouts) >= _MAX_LAYOUTS:
            _layouts.clear()
        layout = _plain_view_at(0, dtype, shape, device, strides)
        _layouts[key] = layout
    # Copy an object that nothing else uses, because making a new one takes several times as long.
    seen = object.__new__(wp.array)
    seen.__dict__ = layout.__dict__.copy()
    seen.ptr = address
    return seen


class _PlainCommand:
    """A launch of a loaded kernel."""

    def __init__(
        self, kernel: wp.Kernel, dim: Any, arguments: Sequence[Any], device: wp.Device, block: int
    ):
        self._given: dict[str, Any] = {"device": device, "block_dim": block}
        self._kernel = kernel

    def launch(self, dim: Any, arguments: Sequence[Any], stream: wp.Stream | None) -> None:
        """Launch with this size and these arguments."""
        wp.launch(self._kernel, dim, arguments, stream=stream, **self._given)


class _QuickCommand:
    """A launch that a thread keeps, with the descriptors of its arguments.

    The descriptors belong to the launch, not to arrays, so that it keeps no memory alive.
    """

    def __init__(
        self, kernel: wp.Kernel, dim: Any, arguments: Sequence[Any], device: wp.Device, block: int
    ):
        self._command = wp.launch(
            kernel, dim, arguments, device=device, record_cmd=True, block_dim=block
        )
        self._dim = dim
        self._known: list[Any] = [None] * len(arguments)  # numbers, and the layouts of arrays
        self._descriptors: list[Any] = [None] * len(arguments)

    def launch(self, dim: Any, arguments: Sequence[Any], stream: wp.Stream | None) -> None:
        """Launch with this size and these arguments; None means the first launch's array."""
        if dim != self._dim:
            self._command.set_dim(dim)
            self._dim = dim
        known, descriptors = self._known, self._descriptors
        for i, argument in enumerate(arguments):
            if isinstance(argument, wp.array):
                layout = argument.shape, argument.strides
                if layout != known[i]:
                    given = argument.__ctype__()
                    descriptors[i] = type(given).from_buffer_copy(given)
                    self._command.set_param_at_index_from_ctype(i, descriptors[i])
                    known[i] = layout
                descriptors[i].data = argument.ptr or 0
            elif hasattr(argument, "__ctype__"):  # a structure
                self._command.set_param_at_index_from_ctype(i, argument.__ctype__())
            elif argument is not known[i]:
                self._command.set_param_at_index_from_ctype(i, argument)
                known[i] = argument
        self._command.launch(stream)


class PackedLaunch:
    """A launch whose arguments are packed once; only documented in parts, so for `QUICK` alone."""

    def __init__(
        self, kernel: wp.Kernel, dim: Any, arguments: Sequence[Any], device: wp.Device, block: int
    ):
        self._command = wp.launch(
            kernel, dim, arguments, device=device, record_cmd=True, block_dim=block
        )
        self.launch = self._command.launch

    def descriptor(self, i: int, array: wp.array) -> Any:
        """Give argument `i`, an array, a descriptor of its own, whose `data` is its address."""
        given = array.__ctype__()
        own = type(given).from_buffer_copy(given)
        self._command.set_param_at_index_from_ctype(i, own)
        return own


view_at = _quick_view_at if QUICK else _plain_view_at
Command = _QuickCommand if QUICK else _PlainCommand


def put_header(folder: Path) -> None:
    """Make Warp look for this thread's precompiled header there, and put it there if missing."""
    context: Any = sys.modules["warp._src.context"]
    context.runtime._pch_dirs[threading.get_ident()] = SimpleNamespace(name=str(folder))


def header_target() -> str:
    """Return a name for Warp's headers and for the processor for which they are compiled."""
    context: Any = sys.modules["warp._src.context"]
    headers = Path(wp.__file__).parent / "native"
    newest = max(file.stat().st_mtime_ns for file in headers.glob("*.h"))
    processor = context._get_host_cpu_name(), sorted(context._get_cpu_feature_set())
    return hashlib.sha256(repr((str(headers), newest, processor)).encode()).hexdigest()[:8]
