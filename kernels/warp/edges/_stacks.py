"""Stacks of images, as kernels see them."""

from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import view


def tall(image: wp.array, dtype: Any = wp.float32) -> wp.array:
    """View the rows of all images of a stack as those of one image."""
    if image.ndim == 2:
        return image
    return view(image, dtype, (image.shape[0] * image.shape[1], image.shape[2]))
