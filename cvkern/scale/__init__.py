"""Images larger than memory, and heaps of files: functions over tiles, threads and clusters."""

from cvkern.scale.groups import Groups, recognize_panoramas
from cvkern.scale.halos import TILED, halo
from cvkern.scale.heaps import Report, map_images
from cvkern.scale.panoramas import Heaped, stitch
from cvkern.scale.tiles import apply

__all__ = [
    "TILED",
    "Groups",
    "Heaped",
    "Report",
    "apply",
    "halo",
    "map_images",
    "recognize_panoramas",
    "stitch",
]
