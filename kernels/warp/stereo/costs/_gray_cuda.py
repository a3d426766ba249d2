"""Grey values of 8 bits on CUDA: one thread a pixel."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})


@wp.func
def itself(value: wp.uint8, scale: float) -> int:
    """Return a byte as it is."""
    return int(value)


@wp.func
def nearest(value: float, scale: float) -> int:
    """Return the nearest number that a byte holds; 0 for NaN."""
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
        image: wp.array3d[scalar],  # (H, W, C)
        scale: float,
        # outputs
        gray: wp.array2d[wp.uint8],  # (H, W)
    ):
        i = wp.tid()
        width = image.shape[1]
        y = i // width
        x = i - y * width
        value = byte_of(image[y, x, 0], scale)
        if image.shape[2] > 1:
            green = byte_of(image[y, x, 1], scale)
            blue = byte_of(image[y, x, 2], scale)
            value = (77 * value + 150 * green + 29 * blue + 128) >> 8
        gray[y, x] = wp.uint8(value)

    return gray_bytes


gray_bytes = {
    wp.uint8: _gray_bytes(wp.uint8, itself),
    wp.float32: _gray_bytes(wp.float32, nearest),
}
