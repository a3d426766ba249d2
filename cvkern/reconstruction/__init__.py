"""Reconstruction: from photographs to their cameras, and points of the scene."""

from cvkern.reconstruction.bundles import AdjustedBundle, adjust_bundle
from cvkern.reconstruction.files import read_reconstruction, write_reconstruction
from cvkern.reconstruction.models import Reconstruction
from cvkern.reconstruction.structure import reconstruct

__all__ = [
    "AdjustedBundle",
    "Reconstruction",
    "adjust_bundle",
    "read_reconstruction",
    "reconstruct",
    "write_reconstruction",
]
