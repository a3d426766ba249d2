"""Raw pictures: mosaics of colours, exposures, and pictures made of them."""

from cvkern.raw.alignment import Alignment, align_exposures
from cvkern.raw.demosaicing import demosaic
from cvkern.raw.development import develop, fit_color_matrix
from cvkern.raw.exposures import estimate_response, merge_exposures
from cvkern.raw.fusion import fuse_exposures
from cvkern.raw.mosaics import mosaic
from cvkern.raw.tone import tone_map

__all__ = [
    "Alignment",
    "align_exposures",
    "demosaic",
    "develop",
    "estimate_response",
    "fit_color_matrix",
    "fuse_exposures",
    "merge_exposures",
    "mosaic",
    "tone_map",
]
