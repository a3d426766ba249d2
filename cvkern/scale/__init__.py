"""Images larger than memory: functions over tiles."""

from cvkern.scale.halos import TILED, halo
from cvkern.scale.tiles import apply

__all__ = ["TILED", "apply", "halo"]
