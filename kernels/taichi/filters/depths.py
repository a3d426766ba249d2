"""Images of 8 and 16 bits as floats, and back, in Taichi; one thread per element."""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

any_1 = ti.types.ndarray(ndim=1)  # u8 or u16
f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)


@ti.kernel
def _widen(
    src: any_1,
    # outputs
    dst: f32_1,
):
    for i in dst:
        dst[i] = ti.cast(src[i], ti.f32)


@primitive
def widen(src: np.ndarray, dst: np.ndarray) -> None:
    """Convert uint8 or uint16 to float32; one thread per element."""
    _widen(src.reshape(-1), dst.reshape(-1))


@ti.kernel
def _narrow(
    src: f32_1,
    most: ti.f32,
    # outputs
    dst: any_1,
):
    for i in src:
        value = 0.0
        if src[i] > 0.0:  # neither negative nor NaN
            value = ti.min(src[i], most)
        low = ti.floor(value)
        rest = value - low  # exact
        whole = ti.cast(low, ti.i32)
        if rest > 0.5 or (rest == 0.5 and whole % 2 == 1):
            whole += 1
        dst[i] = whole


@primitive
def narrow(src: np.ndarray, dst: np.ndarray) -> None:
    """Round float32 to uint8 or uint16: half to even, beyond the limits to them, NaN to 0."""
    _narrow(src.reshape(-1), float(np.iinfo(dst.dtype).max), dst.reshape(-1))
