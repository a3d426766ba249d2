"""Launches of kernels: on the caller's stream on CUDA, in slabs of rows on CPU threads."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

import warp as wp

from cvkern.kernels._threads import cpu_threads

from ._compiling import load
from ._internals import Command
from ._replays import note, spoil
from ._scratch import scratch, view
from ._streams import current_stream

__all__ = ["BLOCK", "cpu_threads", "launch", "launch_each", "launch_slabs", "scratch", "slabs",
           "view"]  # fmt: skip

# For fewer elements, handing a slab to another thread takes longer than the work.
_SLAB_ELEMENTS = 1 << 16
_MAX_COMMANDS = 512
# Sizes of a kernel with a launch of their own; all others share one, and set its size.
_MAX_DIMS = 24
BLOCK = 256  # threads of a CUDA block, unless a launch says otherwise


class _Commands(threading.local):
    """The launches that a thread keeps."""

    def __init__(self) -> None:
        self.kept: dict[Any, Any] = {}
        self.dims: dict[Any, int] = {}  # numbers of sizes of each kernel


_commands = _Commands()
_lock = threading.Lock()
_loaded: set[tuple[wp.Kernel, str, int]] = set()
_pool: ThreadPoolExecutor | None = None


def launch(
    kernel: wp.Kernel,
    dim: int | tuple[int, ...],
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    block: int = BLOCK,
) -> None:
    """Launch `kernel` once, on the device of its first output; on CUDA in blocks of threads."""
    _send(kernel, dim, (*inputs, *outputs), _device(outputs), block)


def slabs(rows: int, elements: int) -> int:
    """Return the number of slabs for `rows` rows with `elements` elements in total."""
    most = min(rows, elements // _SLAB_ELEMENTS)
    return min(cpu_threads(), most) if most > 1 else 1


def launch_slabs(
    kernel: wp.Kernel, rows: int, count: int, inputs: Sequence[Any], outputs: Sequence[Any]
) -> None:
    """Launch a CPU kernel over rows cut into `count` slabs; each thread takes the next free slab.

    The first three arguments of the kernel are the slab, its first row, and the row after its last.
    """
    device = _device(outputs)
    bounds = [rows * i // count for i in range(count + 1)]
    _share(count, lambda i: (i, bounds[i], bounds[i + 1]), kernel, (*inputs, *outputs), device)


def launch_each(
    kernel: wp.Kernel,
    count: int,
    elements: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
) -> None:
    """Launch a kernel over `count` items: one thread per item on CUDA, slabs of items on the CPU.

    The number of elements of all items decides on the slabs. The first three arguments of the
    kernel are a stride, the first item and the one after the last; its loop is
    ``for i in range(first + wp.tid(), last, stride)``.
    """
    device = _device(outputs)
    if device.is_cuda:
        launch(kernel, count, [count, 0, count, *inputs], outputs)
        return
    number = slabs(count, elements)
    bounds = [count * i // number for i in range(number + 1)]
    _share(number, lambda i: (1, bounds[i], bounds[i + 1]), kernel, (*inputs, *outputs), device)


def _device(outputs: Sequence[Any]) -> wp.Device:
    """Return the device of the first output: an array, or a Warp struct that begins with one."""
    first = outputs[0]
    while not isinstance(first, wp.array):
        first = getattr(first, next(iter(first._cls.vars)))
    return first.device


def _share(
    count: int,
    head: Callable[[int], tuple[int, int, int]],
    kernel: wp.Kernel,
    arguments: Sequence[Any],
    device: wp.Device,
) -> None:
    """Launch a CPU kernel `count` times; each thread takes the next free launch."""
    left, given = iter(range(count)), list(arguments)

    def work() -> None:
        for slab in left:
            _send(kernel, 1, (*head(slab), *given), device)

    if count == 1:
        work()
        return
    spoil()  # other threads do not note their launches
    others = [_threads().submit(work) for _ in range(min(cpu_threads(), count) - 1)]
    work()
    # Nothing is left for a thread that has not begun: waiting for it would cost its wake-up.
    begun = [other for other in others if not other.cancel()]
    wait(begun)
    given.clear()  # a cancelled launch stays in the queue for a while, and would keep the arrays
    for other in begun:
        other.result()


def _send(
    kernel: wp.Kernel,
    dim: int | tuple[int, ...],
    arguments: Sequence[Any],
    device: wp.Device,
    block: int = BLOCK,
) -> None:
    """Launch `kernel` once, on the stream of this thread."""
    key = (kernel, dim, block, device.alias, arguments[-1] is None)
    kept = _commands.kept
    command = kept.get(key)
    if command is None:
        if len(kept) >= _MAX_COMMANDS:
            kept.clear()
            _commands.dims.clear()
        shared = (kernel, None, *key[2:])
        number = _commands.dims.get(shared, 0)
        if number >= _MAX_DIMS:
            key = shared
            command = kept.get(key)
        if command is None:
            _commands.dims[shared] = number + 1
            # Load the variant that launches use, or every slab would load the module again.
            threads = 1 if device.is_cpu else block
            _load(kernel, device, threads)
            command = kept[key] = Command(kernel, dim, arguments, device, threads)
    stream = current_stream(device) if device.is_cuda else None
    note(kernel, dim, arguments, device, 1 if device.is_cpu else block, stream)
    command.launch(dim, arguments, stream)


def _load(kernel: wp.Kernel, device: wp.Device, threads: int) -> None:
    """Compile and load the module of `kernel`.

    This is needed for each kernel, because a kernel that is made later must be added to its module.
    """
    key = (kernel, device.alias, threads)
    if key not in _loaded:
        load(kernel, device, threads)
        _loaded.add(key)


def _threads() -> ThreadPoolExecutor:
    global _pool
    if _pool is None:
        with _lock:
            if _pool is None:
                _pool = ThreadPoolExecutor(max(1, cpu_threads()), thread_name_prefix="cvkern")
    return _pool


def _after_fork() -> None:
    """Reset the parent's threads and locks, because a forked child has none of the threads."""
    global _pool, _lock
    _pool, _lock = None, threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
