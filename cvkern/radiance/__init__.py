"""Radiance fields: scenes of posed photographs, and the cameras that took them."""

from cvkern.radiance.cameras import Cameras, cameras, look_at, pixel_rays, project
from cvkern.radiance.scenes import Bounds, Scene, load_scene

__all__ = [
    "Bounds",
    "Cameras",
    "Scene",
    "cameras",
    "load_scene",
    "look_at",
    "pixel_rays",
    "project",
]
