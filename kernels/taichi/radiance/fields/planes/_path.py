"""The way of a ray through parallel planes, in Taichi; rays.py has the equations."""

import taichi as ti

vec3 = ti.types.vector(3, ti.f32)

SIDEWAYS = 1e-6  # cosine below which a ray is parallel to the planes, or looks back

Path = ti.types.struct(x=ti.f32, right=ti.f32, y=ti.f32, down=ti.f32, eye=ti.f32, ahead=ti.f32)
"""Where a ray meets the plane of a disparity q: at the texel (y + down q, x + right q); the depth
of the ray's origin, and the cosine between the ray and the camera's axis."""

Corner = ti.types.struct(row=ti.i32, column=ti.i32, down=ti.f32, right=ti.f32, inside=ti.i32)
"""The upper left of the four texels around a point of a plane, and the point's offset."""


@ti.func
def path_of(place: ti.template(), origins: ti.template(), directions: ti.template(), ray: ti.i32):
    """Return the way of a ray."""
    o = vec3(0.0)
    d = vec3(0.0)
    for k in ti.static(range(3)):
        o[k] = place[4 * k + 3]
        for i in ti.static(range(3)):
            o[k] += place[4 * k + i] * origins[ray, i]
            d[k] += place[4 * k + i] * directions[ray, i]
    path = Path(x=0.0, right=0.0, y=0.0, down=0.0, eye=o[2], ahead=d[2])
    if d[2] > SIDEWAYS:
        x = d[0] / d[2]
        y = d[1] / d[2]
        path.x = place[12] * x + place[14]
        path.y = place[13] * y + place[15]
        path.right = place[12] * (o[0] - o[2] * x)
        path.down = place[13] * (o[1] - o[2] * y)
    return path


@ti.func
def corner_of(path: Path, disparity: ti.f32, height: ti.i32, width: ti.i32):
    """Return where a ray meets a plane; outside if the plane is behind its origin."""
    corner = Corner(row=0, column=0, down=0.0, right=0.0, inside=0)
    column = path.x + path.right * disparity
    row = path.y + path.down * disparity
    # Every comparison is false for NaN.
    before = path.ahead > SIDEWAYS and disparity * path.eye < 1.0
    if before and ti.min(row, column) >= -0.5 and row <= height - 0.5 and column <= width - 0.5:
        corner.inside = 1
        row = ti.math.clamp(row, 0.0, height - 1.0)
        column = ti.math.clamp(column, 0.0, width - 1.0)
        corner.row = ti.min(ti.cast(row, ti.i32), height - 2)
        corner.column = ti.min(ti.cast(column, ti.i32), width - 2)
        corner.down = row - corner.row
        corner.right = column - corner.column
    return corner


@ti.func
def distance_of(path: Path, disparity: ti.f32) -> ti.f32:
    """Return the distance of a plane along the ray."""
    return (1.0 - disparity * path.eye) / (disparity * path.ahead)


@ti.func
def share_of(at: Corner, i: ti.template(), j: ti.template()) -> ti.f32:
    """Return the weight of the texel i rows down and j columns to the right."""
    down = at.down if ti.static(i == 1) else 1.0 - at.down
    right = at.right if ti.static(j == 1) else 1.0 - at.right
    return down * right
