"""Point clouds: PLY files and films."""

from cvkern.clouds.films import write_animation
from cvkern.clouds.ply import read_ply, write_ply
from cvkern.clouds.turntables import turntable

__all__ = ["read_ply", "turntable", "write_animation", "write_ply"]
