"""Sums over spectra, in Warp.

A colour is ``sum_l s(l) w_c(l)`` of a spectrum s and the weights w_c of its three components, for
example a light times the matching functions of an observer [CIE 15]. Sums are in float64, in the
order of the wavelengths. One thread takes a spectrum; on the CPU, a slab of them.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def project(spectra: wp.array, weights: wp.array, colours: wp.array) -> None:
    """Add up the products of (M, N) spectra with (N, 3) weights, in float64, in order."""
    inputs = [spectra, weights]
    launch_each(_project, colours.shape[0], 3 * spectra.size, inputs, [colours])


@wp.kernel
def _project(
    stride: int,
    first: int,
    last: int,
    spectra: wp.array2d[float],
    weights: wp.array2d[wp.float64],
    # outputs
    colours: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        a = wp.float64(0.0)
        b = wp.float64(0.0)
        c = wp.float64(0.0)
        for n in range(spectra.shape[1]):
            value = wp.float64(spectra[i, n])
            a += value * weights[n, 0]
            b += value * weights[n, 1]
            c += value * weights[n, 2]
        colours[i, 0] = wp.float32(a)
        colours[i, 1] = wp.float32(b)
        colours[i, 2] = wp.float32(c)
