"""Grey values of 8 bits on the CPU: one thread a slab of rows, in C."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_GRAY = """
    const int columns = image.shape[1], channels = image.shape[2];
    const TYPE* from = image.data + (size_t)row * columns * channels;
    unsigned char* to = gray.data + (size_t)row * columns;
    if (channels == 1) {
        #pragma clang loop vectorize(assume_safety)
        for (int x = 0; x < columns; ++x) to[x] = BYTE(from[x]);
        return;
    }
    #pragma clang loop vectorize(assume_safety)
    for (int x = 0; x < columns; ++x) {
        const TYPE* pixel = from + (size_t)x * channels;
        const int red = BYTE(pixel[0]), green = BYTE(pixel[1]), blue = BYTE(pixel[2]);
        to[x] = (77 * red + 150 * green + 29 * blue + 128) >> 8;
    }
"""

# NaN becomes 0.
_ROUNDED = """
    const auto rounded = [scale](float value) {
        const float v = value * scale;
        return (int)(v > 0.0f ? v < 255.0f ? v + 0.5f : 255.0f : 0.0f);
    };
"""


def _gray_bytes(scalar: Any, text: str) -> wp.Kernel:
    """Return the kernel for images of one type."""

    @wp.func_native(text)
    def gray_row(image: wp.array3d[scalar], row: int, scale: float, gray: wp.array2d[wp.uint8]): ...

    @wp.kernel
    def gray_bytes(
        slab: int,
        first: int,
        last: int,
        image: wp.array3d[scalar],  # (H, W, C)
        scale: float,
        # outputs
        gray: wp.array2d[wp.uint8],  # (H, W)
    ):
        for row in range(first, last):
            gray_row(image, row, scale, gray)

    return gray_bytes


gray_bytes = {
    wp.uint8: _gray_bytes(wp.uint8, _GRAY.replace("TYPE", "unsigned char").replace("BYTE", "")),
    wp.float32: _gray_bytes(
        wp.float32, _ROUNDED + _GRAY.replace("TYPE", "float").replace("BYTE", "rounded")
    ),
}
