"""Least squares of photometric stereo on CUDA, which reads each image once."""

from collections.abc import Sequence
from functools import lru_cache

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch

OPTIONS = {"enable_backward": False, "fuse_fp": False}
MOST = 192  # values that stay in the registers of a thread
MOST_PIXELS = 2  # pixels of a thread
BOUNDS = 128, 2  # threads of a block, and blocks of a multiprocessor


def solve(inputs: Sequence[wp.array], outputs: Sequence[wp.array]) -> None:
    """Solve the pixels of up to MOST images."""
    count, block = inputs[0].shape[0], BOUNDS[0]
    blocks = -(-outputs[1].size // (block * pixels(count)))
    launch(kernel(count), blocks * block, inputs, outputs, block)


def pixels(count: int) -> int:
    """Return the pixels that a thread takes of `count` images."""
    return max(1, min(MOST // count, MOST_PIXELS))


@lru_cache
def kernel(count: int) -> wp.Kernel:
    """Make the kernel for `count` images."""
    names = {"COUNT": count, "PIXELS": pixels(count)}

    @_native.kernel("_photometry_cuda.cu", OPTIONS, launch_bounds=BOUNDS, **names)
    def solve_kept(
        images: wp.array3d[float],
        inverse: wp.array2d[float],
        lights: wp.array2d[float],
        mask: wp.array2d[wp.uint8],
        # outputs
        normals: wp.array3d[float],
        albedo: wp.array2d[float],
        residual: wp.array2d[float],
    ):
        """Forward to the native code."""

    return solve_kept
