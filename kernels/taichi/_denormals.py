"""Denormal numbers, below 2^-126, on Taichi's threads of the CPU.

Taichi makes its threads take denormal numbers for 0, which no NumPy code and no other kernel set
does. With glibc on x86-64, each of these threads can be given the usual arithmetic back.
"""

import ctypes
import os
import platform

import numpy as np
import taichi as ti
from taichi.lang.source_builder import SourceBuilder

_BLOCK = 512  # turns of a loop that one thread takes at least
_PATIENCE = 100_000  # times that a thread lets others run before it stops waiting for them
_libc = SourceBuilder()
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.kernel
def _keep(threads: ti.i32, one: ti.i32, begun: i32_1):
    for i in range(threads * _BLOCK):
        if i % _BLOCK == 0:
            _libc.fesetenv(args=[ti.i64(-1)])  # FE_DFL_ENV
            # No thread goes on before all have begun, or one would take the turns of another.
            there, waited = ti.atomic_add(begun[0], one) + 1, 0
            while there < threads and waited < _PATIENCE:
                _libc.sched_yield()
                there = ti.atomic_add(begun[0], one - 1)
                waited += 1


def can_keep_denormals() -> bool:
    """Tell whether this is known to work here."""
    return platform.libc_ver()[0] == "glibc" and platform.machine() == "x86_64"


def keep_denormals(threads: int) -> None:
    """Let the threads of the CPU compute with denormal numbers."""
    _libc.so, _libc.mode = ctypes.CDLL("libm.so.6"), "so"
    config = ti.lang.impl.get_runtime().prog.config()
    cached, config.offline_cache = config.offline_cache, False  # it holds addresses of this process
    try:
        # Taichi takes no more threads than there are cores, whatever it is told.
        _keep(min(threads, os.cpu_count() or 1), 1, np.zeros(1, np.int32))
    finally:
        config.offline_cache = cached
