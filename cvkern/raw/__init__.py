"""Raw pictures: mosaics of colours, exposures, and what is made of them."""

from cvkern.raw.demosaicing import demosaic
from cvkern.raw.mosaics import mosaic

__all__ = [
    "demosaic",
    "mosaic",
]
