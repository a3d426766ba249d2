"""Light on surfaces: rendering, and shape from images of one surface under several lights.

Normals are (x right, y up, z towards the camera), the one exception to the axes of this library;
depth is in pixels and grows away from the camera.
"""

from cvkern.shading.meshes import Mesh, mesh_from_depth
from cvkern.shading.rendering import (
    LambertianGradient,
    lambertian,
    lambertian_backward,
    normals_from_depth,
)

__all__ = [
    "LambertianGradient",
    "Mesh",
    "lambertian",
    "lambertian_backward",
    "mesh_from_depth",
    "normals_from_depth",
]
