"""Masks of surfaces, in Taichi."""

import taichi as ti


@ti.func
def is_inside(mask: ti.template(), y: ti.i32, x: ti.i32) -> ti.i32:
    """Tell whether a mask contains a pixel; an empty array contains all."""
    inside = 1
    if mask.shape[0] > 0:
        inside = ti.cast(mask[y, x] != 0, ti.i32)
    return inside
