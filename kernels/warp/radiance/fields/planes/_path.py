"""The way of a ray through parallel planes, for both devices."""

import warp as wp

from cvkern.kernels.codes.radiance import PLANES_PLACE
from cvkern.kernels.warp.radiance._structs import Rays

wp.set_module_options({"enable_backward": False})

FIRST = wp.constant(PLANES_PLACE)
SIDEWAYS = wp.constant(1e-6)  # cosine below which a ray is parallel to the planes, or looks back


@wp.struct
class Path:
    """Where a ray meets the plane of a disparity q: at the texel (y + down q, x + right q)."""

    x: float
    right: float
    y: float
    down: float
    eye: float  # depth of the ray's origin
    ahead: float  # cosine between the ray and the camera's axis


@wp.struct
class Corner:
    """The upper left of the four texels around a point of a plane."""

    row: int
    column: int
    down: float  # offset of the point, in texels
    right: float
    inside: bool


@wp.func
def path_of(at: wp.array[float], rays: Rays, ray: int) -> Path:
    """Return the way of a ray."""
    o = wp.vec3(rays.origins[ray, 0], rays.origins[ray, 1], rays.origins[ray, 2])
    d = wp.vec3(rays.directions[ray, 0], rays.directions[ray, 1], rays.directions[ray, 2])
    across = wp.vec3(at[0], at[1], at[2])
    along = wp.vec3(at[4], at[5], at[6])
    axis = wp.vec3(at[8], at[9], at[10])
    path = Path()
    path.eye = wp.dot(axis, o) + at[11]
    path.ahead = wp.dot(axis, d)
    if path.ahead > SIDEWAYS:
        x = wp.dot(across, d) / path.ahead
        y = wp.dot(along, d) / path.ahead
        path.x = at[12] * x + at[14]
        path.y = at[13] * y + at[15]
        path.right = at[12] * (wp.dot(across, o) + at[3] - path.eye * x)
        path.down = at[13] * (wp.dot(along, o) + at[7] - path.eye * y)
    return path


@wp.func
def corner_of(path: Path, disparity: float, height: int, width: int) -> Corner:
    """Return where a ray meets a plane; outside if the plane is behind its origin."""
    corner = Corner()
    column = path.x + path.right * disparity
    row = path.y + path.down * disparity
    # Every comparison is false for NaN.
    corner.inside = (
        path.ahead > SIDEWAYS
        and disparity * path.eye < 1.0
        and row >= -0.5
        and column >= -0.5
        and row <= float(height) - 0.5
        and column <= float(width) - 0.5
    )
    if corner.inside:
        row = wp.clamp(row, 0.0, float(height - 1))
        column = wp.clamp(column, 0.0, float(width - 1))
        corner.row = wp.min(int(row), height - 2)
        corner.column = wp.min(int(column), width - 2)
        corner.down = row - float(corner.row)
        corner.right = column - float(corner.column)
    return corner


@wp.func
def distance_of(path: Path, disparity: float) -> float:
    """Return the distance of a plane along the ray."""
    return (1.0 - disparity * path.eye) / (disparity * path.ahead)
