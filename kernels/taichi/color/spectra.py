"""Sums over spectra, in Taichi.

A colour is ``sum_l s(l) w_c(l)`` of a spectrum s and the weights w_c of its three components, for
example a light times the matching functions of an observer [CIE 15]. Sums are in float64, in the
order of the wavelengths. One thread takes a spectrum.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import wide_product

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)


@ti.kernel
def _project(spectra: f32_2, weights: f64_2, zero: ti.i32, colours: f32_2):
    for i in range(colours.shape[0]):
        sums = ti.Vector([0.0, 0.0, 0.0], dt=ti.f64)
        for n in range(spectra.shape[1]):
            value = ti.cast(spectra[i, n], ti.f64)
            for c in ti.static(range(3)):
                sums[c] += wide_product(value, weights[n, c], zero)
        for c in ti.static(range(3)):
            colours[i, c] = ti.cast(sums[c], ti.f32)


@primitive
def project(spectra: np.ndarray, weights: np.ndarray, colours: np.ndarray) -> None:
    """Add up the products of (M, N) spectra with (N, 3) weights, in float64, in order.

    One thread a spectrum.
    """
    _project(spectra, weights, 0, colours)
