"""Light on surfaces: rendering, and shape from images of one surface under several lights.

Normals are (x right, y up, z towards the camera), the one exception to the axes of this library;
depth is in pixels and grows away from the camera.
"""

from cvkern.shading.integration import integrate_normals
from cvkern.shading.lamps import estimate_lights, lights_from_sphere
from cvkern.shading.meshes import Mesh, mesh_from_depth
from cvkern.shading.photometry import PhotometricStereo, photometric_stereo
from cvkern.shading.recovery import ShapeFromShading, shape_from_shading
from cvkern.shading.rendering import (
    LambertianGradient,
    lambertian,
    lambertian_backward,
    normals_from_depth,
)

__all__ = [
    "LambertianGradient",
    "Mesh",
    "PhotometricStereo",
    "ShapeFromShading",
    "estimate_lights",
    "integrate_normals",
    "lambertian",
    "lambertian_backward",
    "lights_from_sphere",
    "mesh_from_depth",
    "normals_from_depth",
    "photometric_stereo",
    "shape_from_shading",
]
