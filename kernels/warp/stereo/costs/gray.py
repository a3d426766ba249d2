"""Grey values of 8 bits, which stereo matching compares, in Warp.

    grey = (77 red + 150 green + 29 blue + 128) >> 8

This is the luma of ITU-R BT.601 in integers, from bytes. One thread per pixel on CUDA, per run of
pixels on the CPU.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch_each, view

# Without fused multiply-add a value has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _itself(value: wp.uint8, scale: float) -> int:
    """Return a byte unchanged."""
    return int(value)


@wp.func
def _nearest(value: float, scale: float) -> int:
    """Return the nearest integer in [0, 255]; 0 for NaN."""
    v = value * scale
    byte = int(0)
    if v >= 255.0:
        byte = 255
    elif v > 0.0:
        byte = int(v + 0.5)
    return byte


def _gray_bytes(scalar: Any, byte_of: Any) -> wp.Kernel:
    """Return the kernel for images of one type."""

    @wp.kernel
    def gray_bytes(
        stride: int,
        first: int,
        last: int,
        image: wp.array2d[scalar],  # (H W, C)
        scale: float,
        # outputs
        gray: wp.array[wp.uint8],  # (H W,)
    ):
        for i in range(first + wp.tid(), last, stride):
            value = byte_of(image[i, 0], scale)
            if image.shape[1] > 1:
                green = byte_of(image[i, 1], scale)
                blue = byte_of(image[i, 2], scale)
                value = (77 * value + 150 * green + 29 * blue + 128) >> 8
            gray[i] = wp.uint8(value)

    return gray_bytes


_KERNELS = {
    wp.uint8: _gray_bytes(wp.uint8, _itself),
    wp.float32: _gray_bytes(wp.float32, _nearest),
}


def gray_bytes(image: wp.array, scale: float, gray: wp.array) -> None:
    """Convert an image of 1, or of 3 or more channels, to grey values of 8 bits.

    uint8 values are used unchanged. float32 values are multiplied by `scale`, rounded, and clipped
    to [0, 255]. The first three channels are red, green and blue.
    """
    pixels = gray.size
    flat = view(image, image.dtype, (pixels, image.shape[2]))
    outputs = [view(gray, wp.uint8, (pixels,))]
    launch_each(_KERNELS[image.dtype], pixels, image.size, [flat, scale], outputs)
