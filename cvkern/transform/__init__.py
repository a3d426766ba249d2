"""Geometric transforms: sampling, homographies, resizing, pyramids."""

from cvkern.transform.projective import rectify_plane, rotate, warp_perspective
from cvkern.transform.pyramids import pyramid_gaussian, pyramid_laplacian
from cvkern.transform.resampling import resize
from cvkern.transform.sampling import RemapGradient, remap, remap_backward

__all__ = [
    "RemapGradient",
    "pyramid_gaussian",
    "pyramid_laplacian",
    "rectify_plane",
    "remap",
    "remap_backward",
    "resize",
    "rotate",
    "warp_perspective",
]
