"""Sums and ends of logarithms, in integers, in Taichi."""

import taichi as ti

from cvkern.kernels.codes.raw import SLOTS, STEPS

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i64_2 = ti.types.ndarray(dtype=ti.i64, ndim=2)


@ti.kernel
def add_up(logs: f32_2, sums: i64_2):
    for y, x in logs:
        if logs[y, x] > -500.0:
            fixed = ti.cast(ti.floor(logs[y, x] * float(STEPS) + 0.5), ti.i64)
            slot = (y * logs.shape[1] + x) % SLOTS
            ti.atomic_add(sums[slot, 0], fixed)
            ti.atomic_add(sums[slot, 1], ti.i64(1))
            ti.atomic_max(sums[slot, 2], ti.i64(2**32) - fixed)
            ti.atomic_max(sums[slot, 3], ti.i64(2**32) + fixed)
