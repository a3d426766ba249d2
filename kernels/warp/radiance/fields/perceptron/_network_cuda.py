"""The perceptrons of a hash field on CUDA: all layers of 16 samples in a warp's registers.

network.py says what is computed. The gradient of a layer's weights is a sum over samples. A block
stores inputs and gradients of outputs of 64 samples side by side in shared memory. Each of its four
warps sums a part of each layer's gradient in registers, until there are no more samples: 16 columns
of layers that have 64, 16 rows of layers that have 16. No order depends on timing, so a gradient is
the same in each run.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.radiance import MOST_LOG_DENSITY, MOST_LOG_DENSITY_GRADIENT
from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance._structs import Sides

OPTIONS = {"enable_backward": False}
FORWARD = 256  # threads of a block
BACKWARD = 128
SIDES = {"Sides": Sides.native_name}


def _sizes(inputs: int, color: bool, lit: bool) -> dict[str, Any]:
    """Return the constants of _network.cu."""
    most = f"{MOST_LOG_DENSITY}f"
    return {"INPUTS": inputs, "COLOR": int(color), "LIT": int(lit), "MOST_LOG_DENSITY": most}


@cache
def forward(inputs: int, lit: bool) -> wp.Kernel:
    """Return the kernel of densities and colours from `inputs` features, and lights if `lit`.

    Without, its lights are not read.
    """

    @_native.func_native("_network_cuda.cu", **_sizes(inputs, True, lit), **SIDES)
    def pass_on(
        features: wp.array2d[wp.float16],
        sides: Sides,
        total: wp.array[int],
        weights: wp.array[wp.float16],
        sigma: wp.array[float],
        rgb: wp.array2d[float],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS, launch_bounds=(FORWARD, 2))
    def forward(
        features: wp.array2d[wp.float16],  # (M, inputs)
        sides: Sides,
        total: wp.array[int],  # (1,)
        weights: wp.array[wp.float16],  # (W,)
        # outputs
        sigma: wp.array[float],  # (M,)
        rgb: wp.array2d[float],  # (M, 3)
    ):
        pass_on(features, sides, total, weights, sigma, rgb)

    return forward


@cache
def density(inputs: int) -> wp.Kernel:
    """Return the kernel of densities only."""

    @_native.func_native("_network_cuda.cu", **_sizes(inputs, False, False))
    def pass_density(
        features: wp.array2d[wp.float16],
        total: wp.array[int],
        weights: wp.array[wp.float16],
        sigma: wp.array[float],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS, launch_bounds=(FORWARD, 2))
    def density(
        features: wp.array2d[wp.float16],  # (M, inputs)
        total: wp.array[int],  # (1,)
        weights: wp.array[wp.float16],  # (W,)
        # outputs
        sigma: wp.array[float],  # (M,)
    ):
        pass_density(features, total, weights, sigma)

    return density


@cache
def backward(inputs: int, lit: bool) -> wp.Kernel:
    """Return the kernel of all gradients; those of weights have one part per block.

    Without lights, it does not write `d_lights`.
    """
    most = {"MOST_LOG_DENSITY_GRADIENT": f"{MOST_LOG_DENSITY_GRADIENT}f"}

    @_native.func_native("_network_back_cuda.cu", **_sizes(inputs, True, lit), **SIDES, **most)
    def pass_back(
        d_sigma: wp.array[float],
        d_rgb: wp.array2d[float],
        features: wp.array2d[wp.float16],
        sides: Sides,
        total: wp.array[int],
        weights: wp.array[wp.float16],
        sigma: wp.array[float],
        rgb: wp.array2d[float],
        d_features: wp.array2d[wp.float16],
        d_lights: wp.array2d[float],
        parts: wp.array2d[float],
    ): ...

    @wp.kernel(module="unique", module_options=OPTIONS, launch_bounds=(BACKWARD, 2))
    def backward(
        d_sigma: wp.array[float],  # (M,)
        d_rgb: wp.array2d[float],  # (M, 3)
        features: wp.array2d[wp.float16],  # (M, inputs)
        sides: Sides,
        total: wp.array[int],  # (1,)
        weights: wp.array[wp.float16],  # (W,)
        sigma: wp.array[float],  # (M,)
        rgb: wp.array2d[float],  # (M, 3)
        # outputs
        d_features: wp.array2d[wp.float16],  # (M, inputs)
        d_lights: wp.array2d[float],  # (M, 16)
        parts: wp.array2d[float],  # (blocks, W)
    ):
        pass_back(
            d_sigma, d_rgb, features, sides, total, weights, sigma, rgb,
            d_features, d_lights, parts,
        )  # fmt: skip

    return backward
