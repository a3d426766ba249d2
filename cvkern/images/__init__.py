"""Read and write images, show values as colours, and draw over photographs.

Images are NumPy arrays of shape (H, W) or (H, W, C). Positions are (row, column) in pixels, and
pixel centres are integers.
"""

from cvkern.images._colormaps import COLORMAPS
from cvkern.images.colors import apply_colormap, luma
from cvkern.images.drawing import (
    draw_circles,
    draw_epipolar_lines,
    draw_lines,
    draw_points,
    overlay_mask,
)
from cvkern.images.files import read_image, write_image

__all__ = [
    "COLORMAPS",
    "apply_colormap",
    "draw_circles",
    "draw_epipolar_lines",
    "draw_lines",
    "draw_points",
    "luma",
    "overlay_mask",
    "read_image",
    "write_image",
]
