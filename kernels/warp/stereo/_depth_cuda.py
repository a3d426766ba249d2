"""Depth and points on CUDA: one thread per pixel; depth.py has the equations."""

import warp as wp

from .refinement._none import none

# Without fused multiply-add a point has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})


@wp.kernel
def depth(
    disparity: wp.array[float],
    scale: float,
    doffs: float,
    # outputs
    depth: wp.array[float],
):
    i = wp.tid()
    s = disparity[i] + doffs
    z = none()
    if s > 0.0 and wp.isfinite(s):
        z = scale / s
    elif s == 0.0:
        z = wp.inf
    depth[i] = z


@wp.func
def mapped(q: wp.array2d[float], row: int, x: float, y: float, d: float) -> float:
    """Return one coordinate of q (x, y, d, 1)."""
    return q[row, 0] * x + q[row, 1] * y + q[row, 2] * d + q[row, 3]


@wp.func
def reprojected(q: wp.array2d[float], x: float, y: float, d: float) -> wp.vec3:
    """Return the point of a pixel, NaN if it has none."""
    p = wp.vec3(none())
    w = mapped(q, 3, x, y, d)
    if wp.isfinite(d) and w != 0.0:
        for k in range(3):
            p[k] = mapped(q, k, x, y, d) / w
    return p


@wp.kernel
def points(
    disparity: wp.array2d[float],  # (H, W)
    q: wp.array2d[float],  # (4, 4)
    # outputs
    points: wp.array3d[float],  # (H, W, 3)
):
    i = wp.tid()
    y = i // disparity.shape[1]
    x = i - y * disparity.shape[1]
    p = reprojected(q, float(x), float(y), disparity[y, x])
    for k in range(3):
        points[y, x, k] = p[k]
