"""Points in the axes of a view, and their images through a lens, in Warp."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

f64 = wp.float64


@wp.func
def turned(views: wp.array2d[f64], c: int, points: wp.array2d[f64], p: int) -> wp.vec3d:
    """Return R W."""
    x = points[p, 0]
    y = points[p, 1]
    z = points[p, 2]
    return wp.vec3d(
        views[c, 0] * x + views[c, 1] * y + views[c, 2] * z,
        views[c, 3] * x + views[c, 4] * y + views[c, 5] * z,
        views[c, 6] * x + views[c, 7] * y + views[c, 8] * z,
    )


@wp.func
def radial(lenses: wp.array2d[f64], n: int, r2: f64) -> f64:
    """Return by how much a lens stretches a direction of the squared length r2."""
    return f64(1.0) + r2 * (lenses[n, 4] + r2 * (lenses[n, 5] + r2 * lenses[n, 8]))


@wp.func
def bent(lenses: wp.array2d[f64], n: int, u: f64, v: f64) -> wp.vec2d:
    """Return where a lens shows the direction (u, v, 1)."""
    r2 = u * u + v * v
    p1 = lenses[n, 6]
    p2 = lenses[n, 7]
    grown = radial(lenses, n, r2)
    return wp.vec2d(
        u * grown + f64(2.0) * p1 * u * v + p2 * (r2 + f64(2.0) * u * u),
        v * grown + p1 * (r2 + f64(2.0) * v * v) + f64(2.0) * p2 * u * v,
    )
