"""Images larger than memory, and heaps of files: functions over tiles, threads and clusters."""

from cvkern.scale.halos import TILED, halo
from cvkern.scale.heaps import Report, map_images
from cvkern.scale.tiles import apply

__all__ = ["TILED", "Report", "apply", "halo", "map_images"]
