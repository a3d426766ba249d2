"""Masks of surfaces, in Warp."""

import warp as wp


@wp.func
def is_inside(mask: wp.array2d[wp.uint8], y: int, x: int) -> bool:
    """Tell whether a mask contains a pixel; an empty array contains all."""
    if mask.shape[0] == 0:
        return True
    return mask[y, x] != wp.uint8(0)
