"""Modules of kernels: compiled once, several at a time, and kept in Warp's cache.

A module takes 0.2 to 1.5 s. Calls of several threads compile their modules at the same time.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import warp as wp

from cvkern.kernels import _cache
from cvkern.kernels._threads import cpu_threads

from ._internals import QUICK, header_target, put_header

_SUM = "sha256"  # a file with the checksum of a header: from a damaged one, Clang may crash

_pool: ThreadPoolExecutor | None = None
_turns: dict[Any, threading.Lock] = {}  # a lock for each module
_lock = threading.Lock()
_header_lock = threading.Lock()
_gpu_lock = threading.Lock()
_headers: dict[Path, Path] = {}  # the folder of the header of each kernel cache


def load(kernel: wp.Kernel, device: wp.Device, block: int) -> None:
    """Compile and load the module of `kernel` for blocks of `block` threads.

    If its cached files cannot be loaded, they are removed once, because a killed process or a full
    disk may have left an incomplete file. If the cache cannot be written to and does not have the
    module, it is replaced by one for this process.

    One thread at a time loads a module. Several threads load several modules for the CPU.
    """
    _leave_out_bfloat16(kernel.module)
    meanwhile = _cache.MEANWHILE.get()
    if meanwhile and device.is_cpu:
        kept = _cached(kernel, block)
        if not (kept and kept.exists()):
            meanwhile()
    if device.is_cpu:
        _compilers().submit(_make, kernel, device, block).result()
    else:
        _make(kernel, device, block)


def _leave_out_bfloat16(module: Any) -> None:
    """Make Warp's headers shorter by a type that we do not use; this is 0.7 s of 1.8."""
    with _lock:
        if module.options.get("cpu_compiler_flags", "") is None:
            flags = wp.config.cpu_compiler_flags
            flags = "-march=native" if flags is None else flags
            flags = f"{flags} -DWP_NO_BFLOAT16="
            wp.set_module_options({"cpu_compiler_flags": flags}, module)


def _make(kernel: wp.Kernel, device: wp.Device, block: int) -> None:
    turn = _turns.setdefault(kernel.module, threading.Lock())
    with turn, nullcontext() if device.is_cpu else _gpu_lock:
        kept = _cached(kernel, block)
        there = kept is not None and kept.parent.is_dir()
        try:
            _load(kernel, device, block, kept)
        except Exception:
            # Another thread may have added a kernel to the module meanwhile.
            if not _mended(kept if there else None) and _cached(kernel, block) == kept:
                raise
            kernel.module.mark_modified()  # reset the failed state
            _load(kernel, device, block, _cached(kernel, block))


def _load(kernel: wp.Kernel, device: wp.Device, block: int, kept: Path | None) -> None:
    reads_headers = kept is not None and device.is_cpu and not kept.exists()
    with _shared_header(kept.parents[1]) if kept and reads_headers else nullcontext():
        if QUICK:
            kernel.module.load(device, block)
        else:
            wp.load_module(kernel.module, device, block_dim=block)


def _mended(kept: Path | None) -> bool:
    """Replace a cache that cannot be written to, or remove the files of a module, if there."""
    with _lock:
        folder = wp.config.kernel_cache_dir
        reason = _cache.refusal(folder) if folder else ""
        if reason:
            replace_cache(reason)
        elif kept is not None:
            shutil.rmtree(kept.parent, ignore_errors=True)
    return bool(reason) or kept is not None


def replace_cache(reason: str) -> None:
    """Keep compiled kernels in a folder for this process only, and warn."""
    _cache.warn("warp", wp.config.kernel_cache_dir or "", reason)
    wp.config.kernel_cache_dir = tempfile.mkdtemp(prefix="cvkern-kernels-")
    atexit.register(shutil.rmtree, wp.config.kernel_cache_dir, ignore_errors=True)


@contextmanager
def _shared_header(cache: Path) -> Iterator[None]:
    """Let this thread compile with the precompiled header of a kernel cache.

    Clang reads Warp's headers for two seconds before it compiles the first kernel for the CPU. By
    default, Warp precompiles them once for each thread that compiles, and removes the result when
    the process ends. If the cache has no header, the first thread makes it by what it compiles, and
    others wait for that.
    """
    if not (QUICK and wp.config.use_precompiled_headers):
        yield
        return
    with _header_lock:
        if cache not in _headers or not _headers[cache].is_dir():
            place = cache / f"wp_cvkern_header_{header_target()}"
            if not _whole(place):
                with _new_header(cache, place):
                    yield
                return
            _headers[cache] = place
    put_header(_headers[cache])
    yield


@contextmanager
def _new_header(cache: Path, place: Path) -> Iterator[None]:
    try:
        made = Path(tempfile.mkdtemp(prefix="wp_cvkern_header_", dir=cache))
    except OSError:  # a cache for reading only, which will be replaced
        yield
        return
    put_header(made)
    try:
        yield
    except BaseException:
        shutil.rmtree(made, ignore_errors=True)
        raise
    try:
        (made / _SUM).write_text(_sum(made))
        shutil.rmtree(place, ignore_errors=True)
        made = made.rename(place)
    except OSError:  # the disk is full, or another process was faster
        atexit.register(shutil.rmtree, made, ignore_errors=True)
    _headers[cache] = made


def _whole(folder: Path) -> bool:
    try:
        return (folder / _SUM).read_text() == _sum(folder)
    except (OSError, ValueError):
        return False


def _sum(folder: Path) -> str:
    found = hashlib.sha256()
    for file in sorted(folder.glob("*.pch")):
        found.update(file.read_bytes())
    return found.hexdigest()


def _cached(kernel: wp.Kernel, block: int) -> Path | None:
    """Return the cached description of the module of `kernel`, or None if Warp does not tell."""
    identify = getattr(kernel.module, "get_module_identifier", None)
    folder = wp.config.kernel_cache_dir
    if identify is None or not folder:
        return None
    name = identify(block)
    return Path(os.fspath(folder), name, f"{name}.meta")


def _compilers() -> ThreadPoolExecutor:
    """Return the threads that compile for the CPU: one, if threads cannot share a header.

    Waiting for another thread can be interrupted, compiling cannot.
    """
    global _pool
    with _lock:
        if _pool is None:
            most = cpu_threads() + 1 if QUICK else 1
            _pool = ThreadPoolExecutor(most, thread_name_prefix="cvkern-compiler")
        return _pool


def _after_fork() -> None:
    """Reset the parent's threads and locks, because a forked child has none of the threads."""
    global _pool, _lock, _header_lock, _gpu_lock
    _pool, _lock = None, threading.Lock()
    _header_lock, _gpu_lock = threading.Lock(), threading.Lock()
    _turns.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
