"""Phases of shifted fringes, and projector coordinates from them, in Taichi.

A pixel sees the fringe of frequency f in N steps as ``I_n = A + B cos(phi - 2 pi n / N)``. With
``S = sum I_n sin(2 pi n / N)`` and ``C = sum I_n cos(2 pi n / N)``, least squares give the phase
``phi = atan2(S, C)`` and the modulation ``B = 2 / N sqrt(S^2 + C^2)`` [Bruning et al. 1974]. In
turns, ``p = phi / 2 pi`` gives the position t along the axis up to whole periods:
``t = (p + k) / f``. The lowest frequency has k = 0. Each other frequency takes the k that is
closest to the position of the one before, ``k = floor(f t - p + 1/2)`` [Zuo et al. 2016, "Temporal
phase unwrapping algorithms for fringe projection profilometry"]. One thread decodes one pixel.
"""

import math

import numpy as np
import taichi as ti

from cvkern.kernels.codes import structured_light as codes
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._polar import gradient_angle, squared_magnitude
from cvkern.kernels.taichi._rounding import product, quotient, root

any_3 = ti.types.ndarray(ndim=3)  # u8, u16 or f32
f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)

TURN = 1 / (2 * math.pi)


@ti.kernel
def _decode(
    frames: any_3,  # (K, H, W)
    begin: ti.i32,
    frequencies: f32_1,
    waves: f32_2,  # (steps, 2): sine, cosine
    size: ti.i32,
    threshold: ti.f32,
    joins: ti.i32,
    zero: ti.i32,
    # outputs
    places: f32_2,
    phases: f32_2,
    modulations: f32_2,
    valid: u8_2,
):
    steps = waves.shape[0]
    for y, x in places:
        t = 0.0
        angle = 0.0
        least = ti.cast(ti.math.inf, ti.f32)
        seen = 1
        for j in range(frequencies.shape[0]):
            s = 0.0
            c = 0.0
            for n in range(steps):
                value = ti.cast(frames[begin + j * steps + n, y, x], ti.f32)
                s += product(value, waves[n, 0], zero)
                c += product(value, waves[n, 1], zero)
            angle = gradient_angle(s, c, zero)
            length = root(squared_magnitude(s, c, zero), zero)
            modulation = quotient(product(2.0, length, zero), ti.cast(steps, ti.f32), zero)
            if not length < ti.math.inf:  # NaN as well
                seen = 0
            if modulation < least:
                least = modulation
            p = product(angle, ti.cast(TURN, ti.f32), zero)
            f = frequencies[j]
            k = 0.0
            if j == 0:
                if p < 0.0:
                    k = 1.0
            else:
                k = ti.floor(product(f, t, zero) - p + 0.5)
            t = quotient(p + k, f, zero)
        # Noise may have moved a position across the end of the first period.
        f = frequencies[0]
        u = product(f, t, zero)
        t = quotient(u - ti.floor(u), f, zero)
        nowhere = ti.bit_cast(0x7FC00000, ti.f32)  # NaN, with these bits everywhere
        places[y, x] = product(t, ti.cast(size, ti.f32), zero) - 0.5 if seen == 1 else nowhere
        phases[y, x] = angle if seen == 1 else nowhere
        modulations[y, x] = least if seen == 1 else nowhere
        good = seen == 1 and least > threshold
        valid[y, x] = ti.cast(good and (joins == 0 or valid[y, x] != 0), ti.u8)


@primitive
def decode(frames: np.ndarray, begin: int, fringes: codes.Fringes, decoded: codes.Decoded) -> None:
    """Decode the frames of an axis, from frame `begin` on; one thread a pixel."""
    _decode(frames, begin, *fringes, 0, *decoded)


@ti.kernel
def _accept(
    columns: f32_2,  # modulations
    rows: f32_2,
    threshold: ti.f32,
    # outputs
    valid: u8_2,
):
    for y, x in valid:
        valid[y, x] = ti.cast(columns[y, x] > threshold and rows[y, x] > threshold, ti.u8)


@primitive
def accept(columns: np.ndarray, rows: np.ndarray, threshold: float, valid: np.ndarray) -> None:
    """Mark the pixels whose modulation of both axes is above the threshold; one thread a pixel."""
    _accept(columns, rows, threshold, valid)
