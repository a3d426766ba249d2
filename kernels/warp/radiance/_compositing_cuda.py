"""Compositing of packed samples along rays on CUDA: one warp per ray, 32 samples at once.

compositing.py has the equations. The arrays belong to the caller, so they need not be aligned for
loads of two numbers.
"""

import warp as wp

from cvkern.kernels.warp import _native

from ._structs import Composited

wp.set_module_options({"enable_backward": False})

THREADS = 32  # threads of a ray


@_native.func_native("_compositing_cuda.cu")
def composite(
    ray: int,
    sigma: wp.array[float],
    rgb: wp.array2d[float],
    distances: wp.array2d[float],
    spans: wp.array2d[int],
    stop: float,
    seen: Composited,
): ...


@_native.func_native("_compositing_cuda.cu")
def take_back(
    ray: int,
    d_seen: Composited,
    sigma: wp.array[float],
    rgb: wp.array2d[float],
    distances: wp.array2d[float],
    spans: wp.array2d[int],
    stop: float,
    d_sigma: wp.array[float],
    d_rgb: wp.array2d[float],
): ...


@wp.kernel
def forward(
    sigma: wp.array[float],  # (M,)
    rgb: wp.array2d[float],  # (M, 3)
    distances: wp.array2d[float],  # (M, 2)
    spans: wp.array2d[int],  # (R, 2)
    stop: float,
    # outputs
    seen: Composited,
):
    """Walk along each ray once."""
    composite(wp.tid() // 32, sigma, rgb, distances, spans, stop, seen)


@wp.kernel
def backward(
    d_seen: Composited,
    sigma: wp.array[float],  # (M,)
    rgb: wp.array2d[float],  # (M, 3)
    distances: wp.array2d[float],  # (M, 2)
    spans: wp.array2d[int],  # (R, 2)
    stop: float,
    # outputs
    d_sigma: wp.array[float],  # (M,)
    d_rgb: wp.array2d[float],  # (M, 3)
):
    """Walk along each ray twice."""
    take_back(wp.tid() // 32, d_seen, sigma, rgb, distances, spans, stop, d_sigma, d_rgb)
