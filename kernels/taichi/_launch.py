"""Taichi's single program: its start, and the decorator through which every primitive launches."""

import contextlib
import functools
import io
import os
import tempfile
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ParamSpec

import numpy as np
import taichi as ti

from cvkern.kernels import _cache
from cvkern.kernels._threads import cpu_threads

from . import _sources, _staging
from ._denormals import can_keep_denormals, keep_denormals

P = ParamSpec("P")

# Taichi compiles and launches on one thread at a time.
_lock = threading.RLock()
_sources.read_once()


class _Program:
    """The Taichi program that runs our kernels."""

    device = ""
    handle: Any = None
    process = 0


class _Caller(threading.local):
    """The device of the calling thread, and its CUDA stream there if it has one."""

    device = ""
    stream: int | None = None


_program = _Program()
_caller = _Caller()
_ARCHS = {
    "cpu": ti.cpu,
    "cuda": ti.cuda,
    "cuda:0": ti.cuda,
    "vulkan": ti.vulkan,
    "metal": ti.metal,
}
STAGED = ("vulkan", "metal")  # devices whose kernels take arrays of the host
_LEGACY = (0, 1)  # names of CUDA's default stream, the only one that Taichi launches on


def start(device: str, stream: int | None = None) -> None:
    """Initialise Taichi on `device`; order this thread's launches with the CUDA stream `stream`.

    A process holds one Taichi program at a time, so a change of device restarts it.
    ``CVKERN_NUM_THREADS`` sets the threads of the CPU; the default is the number of usable cores.

    Raises
    ------
    ValueError
        If Taichi cannot drive `device` here; of several GPUs it drives only the first.
    RuntimeError
        If a driver of Vulkan or Metal computes wrongly, or if other code in this process has a
        Taichi program, because starting ours would destroy its fields. Also in a forked child of a
        process that started Taichi.
    """
    arch = _ARCHS.get(device)
    if arch is None or not ti.lang.misc.is_arch_supported(arch):
        raise ValueError(f"device must be one that taichi finds here, {devices()}, got {device!r}")
    _check_process()
    with _lock:
        _caller.device, _caller.stream = device.partition(":")[0], stream
        _switch(_caller.device, arch)


def devices() -> tuple[str, ...]:
    """Return the names of the devices that Taichi can drive; of several GPUs, only the first."""
    names = ("cuda:0", *STAGED)
    return ("cpu", *(n for n in names if ti.lang.misc.is_arch_supported(_ARCHS[n])))


def primitive(launch: Callable[P, None]) -> Callable[P, None]:
    """Make a launcher safe in any thread, and order it with the caller's CUDA stream."""

    @functools.wraps(launch)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> None:
        _check_process()
        with _lock:
            if not _caller.device:  # a thread that has not called start()
                _caller.device = _program.device
            _switch(_caller.device, _ARCHS[_caller.device])
            if _caller.device == "cpu":
                launch(*args, **kwargs)
            elif _caller.device in STAGED:
                _staging.launch(launch, args, kwargs)
            else:
                _launch_on_cuda(launch, args, kwargs)

    return guarded


def scratch(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """Allocate temporary memory of a primitive, as kernels take it."""
    if _caller.device == "cpu":
        return np.empty(shape, dtype)
    if _caller.device in STAGED:
        return _staging.stage().scratch(shape, dtype)
    from . import _cuda

    return _cuda.header(_cuda.empty(shape, np.dtype(dtype)))


def on_cpu() -> bool:
    """Tell whether the current primitive runs on the CPU."""
    return _caller.device == "cpu"


def synchronize() -> None:
    """Wait for every launch so far."""
    _check_process()
    with _lock:
        ti.sync()


def _switch(device: str, arch: Any) -> None:
    """Make our program run on `device`; another thread or other code may have changed it."""
    current = ti.lang.impl.get_runtime().prog
    if current is not None and current is not _program.handle:
        raise RuntimeError(
            "Taichi is in use by other code in this process, and holds one program at a time: "
            "call taichi.reset() when that code has finished, or use the 'warp' backend"
        )
    if current is not None and device == _program.device:
        return
    # Start on a separate thread, because Taichi sets its starting thread to flush denormal numbers
    # to zero, which would change NumPy's arithmetic.
    with ThreadPoolExecutor(1) as thread:
        thread.submit(_initialise, arch).result()
    _program.device = device
    _program.handle = ti.lang.impl.get_runtime().prog
    _program.process = os.getpid()
    if device in STAGED:
        try:
            _staging.check(device)
        except RuntimeError:
            ti.reset()
            _program.device, _program.handle = "", None
            raise


def _initialise(arch: Any) -> None:
    if _program.device == "cuda":
        import warp as wp

        with wp.ScopedDevice("cuda:0"):  # Taichi frees its memory in the context of this thread
            ti.reset()
    environment = os.environ.pop("TI_ARCH", None)  # it would override `arch`
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # "Starting on arch=..."
            ti.init(
                arch=arch,
                enable_fallback=False,
                default_fp=ti.f32,
                default_ip=ti.i32,
                fast_math=False,
                # It takes half of the time of compiling long kernels, and LLVM does the same.
                cfg_optimization=arch != ti.cpu,
                **_cache_options(),
                cpu_max_num_threads=cpu_threads(),
                log_level=ti.ERROR,
            )
    finally:
        if environment is not None:
            os.environ["TI_ARCH"] = environment
    ti.sync()  # builds the parts that Taichi can build only on its starting thread
    if arch == ti.cpu and can_keep_denormals():
        keep_denormals(cpu_threads())


@functools.lru_cache
def _cache_options() -> dict[str, Any]:
    """Return the options of Taichi's cache; warn if it cannot be written, as Taichi does not."""
    folder = os.environ.get("TI_OFFLINE_CACHE_FILE_PATH")
    folder = folder or ti.lang.impl.default_cfg().offline_cache_file_path
    reason = _cache.refusal(folder)
    if reason:
        _cache.warn("taichi", folder, reason)
        folder = tempfile.gettempdir()  # nothing is written, but Taichi crashes without a folder
    else:
        _cache.unlock(os.path.join(folder, "ticache.lock"))
    return {"offline_cache": not reason, "offline_cache_file_path": folder}


def _launch_on_cuda(launch: Callable[..., None], args: tuple, kwargs: dict[str, Any]) -> None:
    import warp as wp

    from . import _cuda

    def seen(value: Any) -> Any:
        if hasattr(value, "_fields"):  # a named tuple
            return type(value)(*map(seen, value))
        if isinstance(value, list):
            return list(map(seen, value))
        return _cuda.header(value) if isinstance(value, wp.array) else value

    if _caller.stream is not None and _caller.stream not in _LEGACY:
        wp.synchronize_stream(wp.Stream(_cuda.DEVICE, cuda_stream=_caller.stream))
    launch(*map(seen, args), **{name: seen(value) for name, value in kwargs.items()})
    if _caller.stream not in _LEGACY:
        ti.sync()


def _check_process() -> None:
    """Refuse a forked process: it has the state of its parent's Taichi without its threads."""
    if _program.process not in (0, os.getpid()):
        raise RuntimeError(
            "Taichi cannot run in a forked process: start workers with the 'spawn' method"
        )
