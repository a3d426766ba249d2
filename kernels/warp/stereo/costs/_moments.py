"""Sums and scales of windows for the cross-correlation, on both devices.

A thread computes one value: first the sums down the columns, then the sums along the rows. The
scale of a window is 1 / sqrt(n S(l l) - S(l)^2), summed over the channels, and 0 if this variance
is only rounding error. Float64 holds sums of bytes exactly; floats are summed from top to bottom
and from left to right.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.stereo import FLAT
from cvkern.kernels.warp._launch import launch_each, scratch

# Without fused multiply-add a sum has the same bits on every device.
_OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(_OPTIONS)


@wp.struct
class Moments:
    """Sums and scales of the windows of an image, with centres from column -r to W - 1 + r."""

    sums: wp.array3d[wp.float64]  # (H, W + 2 r, C)
    scales: wp.array2d[wp.float64]  # (H, W + 2 r)


@lru_cache
def _down(pixel: Any) -> wp.Kernel:
    """Return the kernel for images of one type."""

    @wp.kernel(module="unique", module_options=_OPTIONS)
    def down(
        stride: int,
        first: int,
        last: int,
        image: wp.array3d[pixel],  # (H, W, C)
        radius_y: int,
        # outputs, (H, W, C)
        sums: wp.array3d[wp.float64],
        squares: wp.array3d[wp.float64],
    ):
        for i in range(first + wp.tid(), last, stride):
            y = i // image.shape[1]
            x = i - y * image.shape[1]
            for c in range(image.shape[2]):
                total = wp.float64(0.0)
                square = wp.float64(0.0)
                for v in range(y - radius_y, y + radius_y + 1):
                    value = wp.float64(image[wp.clamp(v, 0, image.shape[0] - 1), x, c])
                    total += value
                    square += value * value
                sums[y, x, c] = total
                squares[y, x, c] = square

    return down


@wp.kernel
def _along(
    stride: int,
    first: int,
    last: int,
    down: wp.array3d[wp.float64],  # (H, W, C)
    down_squares: wp.array3d[wp.float64],
    radius_x: int,
    n: wp.float64,
    # outputs
    sums: wp.array3d[wp.float64],  # (H, W + 2 radius_x, C)
    scales: wp.array2d[wp.float64],  # (H, W + 2 radius_x)
):
    width = down.shape[1]
    for i in range(first + wp.tid(), last, stride):
        y = i // scales.shape[1]
        j = i - y * scales.shape[1]
        energy = wp.float64(0.0)
        spread = wp.float64(0.0)
        for c in range(down.shape[2]):
            total = wp.float64(0.0)
            square = wp.float64(0.0)
            for u in range(j - 2 * radius_x, j + 1):
                x = wp.clamp(u, 0, width - 1)
                total += down[y, x, c]
                square += down_squares[y, x, c]
            sums[y, j, c] = total
            energy += n * square
            spread += n * square - total * total
        scale = wp.float64(0.0)
        if spread > wp.float64(FLAT) * energy:
            scale = wp.float64(1.0) / wp.sqrt(spread)
        scales[y, j] = scale


def moments(name: str, image: wp.array, radius_y: int, radius_x: int) -> Moments:
    """Return the sums and scales of an image's windows, in scratch memory of this name."""
    height, width, channels = image.shape
    wide, device = width + 2 * radius_x, image.device
    n = float((2 * radius_y + 1) * (2 * radius_x + 1))
    down = [
        scratch(f"zncc.{what}", image.shape, wp.float64, device) for what in ("sums", "squares")
    ]
    pixels = height * width
    launch_each(_down(image.dtype), pixels, image.size * radius_y, [image, radius_y], down)
    result = Moments()
    result.sums = scratch(f"zncc.{name}_sums", (height, wide, channels), wp.float64, device)
    result.scales = scratch(f"zncc.{name}_scales", (height, wide), wp.float64, device)
    outputs = [result.sums, result.scales]
    launch_each(_along, height * wide, image.size * radius_x, [*down, radius_x, n], outputs)
    return result
