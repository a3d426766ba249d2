"""Layers of a perceptron in Taichi, in float32."""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import on_cpu, primitive, scratch

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
vec16 = ti.types.vector(16, ti.f32)

PARTS = 64  # parts of the samples; one GPU thread adds each


@ti.kernel
def _forward(
    x: f32_2,  # (M, >= K)
    w: f32_2,  # (K, N)
    total: i32_1,  # (1,)
    relu: ti.i32,
    column: ti.i32,
    # outputs
    y: f32_2,  # (M, >= column + N)
):
    for i, tile in ti.ndrange(ti.min(total[0], x.shape[0]), w.shape[1] // 16):
        sums = vec16(0.0)
        for k in range(w.shape[0]):
            value = x[i, k]
            for n in ti.static(range(16)):
                sums[n] += value * w[k, 16 * tile + n]
        if relu != 0:
            sums = ti.max(sums, 0.0)
        for n in ti.static(range(16)):
            y[i, column + 16 * tile + n] = sums[n]


@primitive
def forward(
    x: np.ndarray, w: np.ndarray, total: np.ndarray, relu: bool, column: int, y: np.ndarray
) -> None:
    """Compute ``y[:, column:column + N] = x w`` for the first `total` (1,) rows, >= 0 if `relu`.

    `x` is (M, >= K), `w` (K, N) and `y` (M, >= column + N); K and N are multiples of 16.
    """
    _forward(x, w, total, relu, column, y)


@ti.kernel
def _backward_input(
    dy: f32_2,  # (M, >= column + N)
    w: f32_2,  # (K, N)
    x: f32_2,  # (M, >= K)
    total: i32_1,  # (1,)
    gated: ti.i32,
    column: ti.i32,
    # outputs
    dx: f32_2,  # (M, >= K)
):
    for i, k in ti.ndrange(ti.min(total[0], x.shape[0]), w.shape[0]):
        sums = vec16(0.0)
        if gated == 0 or x[i, k] > 0.0:
            for tile in range(w.shape[1] // 16):
                for n in ti.static(range(16)):
                    sums[n] += dy[i, column + 16 * tile + n] * w[k, 16 * tile + n]
        dx[i, k] = sums.sum()


@primitive
def backward_input(
    dy: np.ndarray,
    w: np.ndarray,
    x: np.ndarray,
    total: np.ndarray,
    gated: bool,
    column: int,
    dx: np.ndarray,
) -> None:
    """``dx = dy[:, column:column + N] w^T``, from y = x w, for the first `total` (1,) rows.

    If `gated`, `x` (M, K) is the output of a layer with `relu`, and `dx` (M, K) is 0 where `x` is
    0.
    """
    _backward_input(dy, w, x, total, gated, column, dx)


@ti.kernel
def _backward_weight(
    dy: f32_2,  # (M, >= column + N)
    x: f32_2,  # (M, >= K)
    total: i32_1,  # (1,)
    column: ti.i32,
    # outputs
    parts: f32_3,  # (P, K, N)
    dw: f32_2,  # (K, N): added to
):
    count = parts.shape[0]
    for row, tile, part in ti.ndrange(dw.shape[0] // 4, dw.shape[1] // 16, count):
        sums = ti.Matrix.zero(ti.f32, 4, 16)
        for turn in range((total[0] - part + count - 1) // count):
            i = part + turn * count
            for k in ti.static(range(4)):
                value = x[i, 4 * row + k]
                for n in ti.static(range(16)):
                    sums[k, n] += value * dy[i, column + 16 * tile + n]
        for k in ti.static(range(4)):
            for n in ti.static(range(16)):
                parts[part, 4 * row + k, 16 * tile + n] = sums[k, n]
    for k, n in dw:
        for part in range(count):
            dw[k, n] = dw[k, n] + parts[part, k, n]


@primitive
def backward_weight(
    dy: np.ndarray, x: np.ndarray, total: np.ndarray, column: int, dw: np.ndarray
) -> None:
    """``dw += x^T dy[:, column:column + N]``, from y = x w, over the first `total` (1,) rows.

    `x` is (M, >= K), `dw` (K, N) float32. The order of the sums is always the same.
    """
    parts = scratch((1 if on_cpu() else PARTS, *dw.shape), np.float32)
    _backward_weight(dy, x, total, column, parts, dw)
