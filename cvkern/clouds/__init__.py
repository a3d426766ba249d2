"""Point clouds: PLY files and films."""

from cvkern.clouds.films import write_animation
from cvkern.clouds.ply import write_ply
from cvkern.clouds.turntables import turntable

__all__ = ["turntable", "write_animation", "write_ply"]
