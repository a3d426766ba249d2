"""How kernels are launched: on the caller's stream on CUDA, in slabs of rows on CPU threads.

Also the scratch memory of primitives, kept for each thread and stream.
"""

from __future__ import annotations

import contextlib
import math
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

import warp as wp

# A slab smaller than this is done sooner by one thread than handed to another.
_SLAB_ELEMENTS = 1 << 16
_MAX_COMMANDS = 512
_MAX_VIEWS = 16  # of an array
_MAX_LAYOUTS = 512
BLOCK = 256  # threads of a CUDA block, unless a launch says otherwise
PAGE = 4096  # bytes: to bring so many to the host, all but the copy itself takes longest


class _ThreadState(threading.local):
    """What the launches of one Python thread share: their stream and their scratch memory."""

    stream: wp.Stream | None = None
    fixed: bool = False  # whether the stream stays whatever the callers' arrays say
    page: wp.array | None = None

    def __init__(self) -> None:
        self.streams_scratch: dict[tuple[str, str, int], wp.array] = {}
        self.scratch = self.streams_scratch
        self.commands: dict[Any, _Command] = {}


_thread = _ThreadState()
_lock = threading.Lock()
_loaded: set[tuple[wp.Kernel, str, int]] = set()
_layouts: dict[Any, wp.array] = {}
_pool: ThreadPoolExecutor | None = None


def cpu_threads() -> int:
    """Return how many threads CPU kernels use: ``CVKERN_NUM_THREADS``, or the cores we may use."""
    asked = os.environ.get("CVKERN_NUM_THREADS")
    if asked:
        return int(asked)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def set_stream(stream: wp.Stream | None) -> None:
    """Send this thread's CUDA launches to `stream`."""
    if not _thread.fixed:
        _thread.stream = stream


@contextlib.contextmanager
def only_stream(stream: wp.Stream) -> Iterator[None]:
    """Send the launches of the block to `stream`, whatever :func:`set_stream` is told."""
    before = _thread.stream
    _thread.stream, _thread.fixed = stream, True
    try:
        yield
    finally:
        _thread.stream, _thread.fixed = before, False


def current_stream(device: wp.Device) -> wp.Stream:
    """Return the stream that this thread's launches on `device` go to."""
    stream = _thread.stream
    return stream if stream is not None and stream.device == device else device.stream


@contextlib.contextmanager
def own_scratch(scratch: dict[tuple[str, str, int], wp.array]) -> Iterator[None]:
    """Use `scratch` for the block: a CUDA graph keeps the addresses it was recorded with."""
    shared, _thread.scratch = _thread.scratch, scratch
    try:
        yield
    finally:
        _thread.scratch = shared


def known_scratch(device: wp.Device) -> dict[tuple[str, str, int], wp.array]:
    """Return what :func:`scratch` has given this thread on its stream, for :func:`own_scratch`."""
    shared = _thread.scratch is _thread.streams_scratch
    stream = current_stream(device).cuda_stream or 0 if shared else 0
    return {
        (name, where, 0): block
        for (name, where, of), block in _thread.scratch.items()
        if (where, of) == (device.alias, stream)
    }


def scratch(name: str, shape: tuple[int, ...], dtype: Any, device: wp.Device) -> wp.array:
    """Return uninitialised memory that stays valid until this thread asks for `name` again."""
    shared = _thread.scratch is _thread.streams_scratch
    stream = current_stream(device).cuda_stream or 0 if device.is_cuda and shared else 0
    key = (name, device.alias, stream)
    count = math.prod(shape) * wp.types.type_size_in_bytes(dtype)
    block = _thread.scratch.get(key)
    if block is None or block.capacity < count:
        if block is not None and device.is_cuda:  # kernels may still be at work in the old one
            wp.synchronize_stream(current_stream(device))
        # In words: Warp counts the elements of an axis with 31 bits.
        block = wp.empty(-(-count // 8), dtype=wp.uint64, device=device)
        if device.is_cuda:  # the allocation is ordered on another stream than its users
            wp.synchronize_stream(device.stream)
        _thread.scratch[key] = block
    return view(block, dtype, shape)


def page(dtype: Any, shape: tuple[int, ...]) -> wp.array:
    """Return host memory that a GPU writes to directly, of this thread, of at most `PAGE` bytes."""
    if _thread.page is None:
        _thread.page = wp.empty(PAGE, dtype=wp.uint8, device="cpu", pinned=True)
    return view(_thread.page, dtype, shape)


def view(
    array: wp.array, dtype: Any, shape: tuple[int, ...], strides: tuple[int, ...] | None = None
) -> wp.array:
    """See the memory of `array` otherwise; the view is kept with it."""
    views = array.__dict__.setdefault("views", {})
    key = (dtype, shape)
    seen = views.get(key)
    if seen is None:
        if len(views) >= _MAX_VIEWS:
            views.clear()
        seen = views[key] = view_at(array.ptr, dtype, shape, array.device, strides)
    return seen


def view_at(
    address: int | None,
    dtype: Any,
    shape: tuple[int, ...],
    device: wp.Device,
    strides: tuple[int, ...] | None = None,
) -> wp.array:
    """See the memory at an address, without keeping it alive."""
    key = (dtype, shape, device.alias, strides)
    layout = _layouts.get(key)
    if layout is None:
        if len(_layouts) >= _MAX_LAYOUTS:
            _layouts.clear()
        layout = wp.array(ptr=0, dtype=dtype, shape=shape, strides=strides, device=device)
        _layouts[key] = layout
    # A copy of an array that nobody else has: to make one anew takes several times as long.
    seen = object.__new__(wp.array)
    seen.__dict__ = layout.__dict__.copy()
    seen.ptr = address
    return seen


def launch(
    kernel: wp.Kernel,
    dim: int | tuple[int, ...],
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    block: int = BLOCK,
) -> None:
    """Launch `kernel` once, on the device of its first output, on CUDA in blocks of threads."""
    _send(kernel, dim, (*inputs, *outputs), _device(outputs), block)


def slabs(rows: int, elements: int) -> int:
    """Return into how many slabs the CPU cuts `rows` rows of `elements` elements in all."""
    most = min(rows, elements // _SLAB_ELEMENTS)
    return min(cpu_threads(), most) if most > 1 else 1


def launch_slabs(
    kernel: wp.Kernel, rows: int, count: int, inputs: Sequence[Any], outputs: Sequence[Any]
) -> None:
    """Launch a CPU kernel over rows cut into `count` slabs; each thread takes the next one left.

    The kernel runs one thread a slab; its first three arguments are the slab, its first row and
    the row behind its last.
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
    """Launch a kernel over `count` items, of so many elements in all: a thread each, or in slabs.

    The first three arguments of the kernel are a stride, the first item and the one behind the
    last; its loop is ``for i in range(first + wp.tid(), last, stride)``.
    """
    device = _device(outputs)
    if device.is_cuda:
        launch(kernel, count, [count, 0, count, *inputs], outputs)
        return
    number = slabs(count, elements)
    bounds = [count * i // number for i in range(number + 1)]
    _share(number, lambda i: (1, bounds[i], bounds[i + 1]), kernel, (*inputs, *outputs), device)


def _device(outputs: Sequence[Any]) -> wp.Device:
    """Return where the first output is: an array, or a Warp struct whose first field is one."""
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
    """Launch a CPU kernel `count` times; each thread takes the next one left."""
    left = iter(range(count))

    def work() -> None:
        for slab in left:
            _send(kernel, 1, (*head(slab), *arguments), device)

    if count == 1:
        work()
        return
    others = [_threads().submit(work) for _ in range(min(cpu_threads(), count) - 1)]
    work()
    wait(others)
    for other in others:
        other.result()


class _Command:
    """A launch that a thread keeps, which spares most of Warp's Python.

    It has descriptors of its own, not arrays, lest it should keep memory alive.
    """

    def __init__(self, command: wp.Launch, count: int):
        self.command = command
        self.known: list[Any] = [None] * count  # numbers, and the layouts of arrays
        self.descriptors: list[Any] = [None] * count

    def launch(self, arguments: Sequence[Any], stream: wp.Stream | None) -> None:
        """Launch with these arguments, where None stands for the same arrays as the first time."""
        known, descriptors = self.known, self.descriptors
        for i, argument in enumerate(arguments):
            if isinstance(argument, wp.array):
                layout = argument.shape, argument.strides
                if layout != known[i]:
                    given = argument.__ctype__()
                    descriptors[i] = type(given).from_buffer_copy(given)
                    self.command.set_param_at_index_from_ctype(i, descriptors[i])
                    known[i] = layout
                descriptors[i].data = argument.ptr or 0
            elif hasattr(argument, "__ctype__"):  # a structure
                self.command.set_param_at_index_from_ctype(i, argument.__ctype__())
            elif argument is not known[i]:
                self.command.set_param_at_index_from_ctype(i, argument)
                known[i] = argument
        self.command.launch(stream)


def _send(
    kernel: wp.Kernel,
    dim: int | tuple[int, ...],
    arguments: Sequence[Any],
    device: wp.Device,
    block: int = BLOCK,
) -> None:
    """Launch `kernel` once, on the stream of this thread."""
    key = (kernel, dim, block, device.alias, arguments[-1] is None)
    command = _thread.commands.get(key)
    if command is None:
        if len(_thread.commands) >= _MAX_COMMANDS:
            _thread.commands.clear()
        _load(kernel, device, block)
        recorded = wp.launch(
            kernel,
            dim,
            arguments,
            device=device,
            record_cmd=True,
            block_dim=1 if device.is_cpu else block,
        )
        command = _thread.commands[key] = _Command(recorded, len(arguments))
    command.launch(arguments, current_stream(device) if device.is_cuda else None)


def _load(kernel: wp.Kernel, device: wp.Device, block: int) -> None:
    """Compile and load the module of `kernel`; Warp must not do that on two threads at once.

    Once for each kernel: one that was made later than others has to be added to its module.
    """
    key = (kernel, device.alias, block)
    if key not in _loaded:
        with _lock:
            if key not in _loaded:
                # The variant that launches will ask for, or every slab would load it again.
                kernel.module.load(device, 1 if device.is_cpu else block)
                _loaded.add(key)


def _threads() -> ThreadPoolExecutor:
    global _pool
    if _pool is None:
        with _lock:
            if _pool is None:
                _pool = ThreadPoolExecutor(max(1, cpu_threads()), thread_name_prefix="cvkern")
    return _pool


def _after_fork() -> None:
    """Forget the parent's threads and locks: a forked child has none of the threads."""
    global _pool, _lock
    _pool, _lock = None, threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
