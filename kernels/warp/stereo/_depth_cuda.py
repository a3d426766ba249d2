"""Depth and points on CUDA, one thread a pixel; clouds on either device, one thread a part."""

import warp as wp

# Without fused multiply-add a point has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

# CUDA's own NaN has other bits than the CPU's.
NAN_BITS = wp.constant(0x7FC00000)


@wp.func
def none() -> float:
    """Return the NaN that stands for nothing."""
    return wp.cast(NAN_BITS, float)


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
    """Return the point of a pixel, NaN where it has none."""
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


@wp.func
def is_kept(points: wp.array3d[float], mask: wp.array2d[wp.uint8], y: int, x: int) -> bool:
    """Tell whether a pixel has a point, and the mask (of all pixels, or one for all) has it."""
    chosen = mask[wp.min(y, mask.shape[0] - 1), wp.min(x, mask.shape[1] - 1)] != wp.uint8(0)
    return (
        chosen
        and wp.isfinite(points[y, x, 0])
        and wp.isfinite(points[y, x, 1])
        and wp.isfinite(points[y, x, 2])
    )


@wp.kernel
def count_points(
    points: wp.array3d[float],  # (H, W, 3)
    mask: wp.array2d[wp.uint8],  # (H, W) or (1, 1)
    # outputs
    counts: wp.array2d[int],  # (H, parts)
):
    y, part = wp.tid()
    width = (points.shape[1] + counts.shape[1] - 1) // counts.shape[1]
    count = int(0)
    for x in range(part * width, wp.min((part + 1) * width, points.shape[1])):
        if is_kept(points, mask, y, x):
            count += 1
    counts[y, part] = count


@wp.kernel
def gather_points(
    points: wp.array3d[float],  # (H, W, 3)
    mask: wp.array2d[wp.uint8],  # (H, W) or (1, 1)
    image: wp.array3d[wp.uint8],  # (H, W, 1 or 3)
    starts: wp.array2d[int],  # (H, parts)
    # outputs
    cloud: wp.array2d[float],  # (N, 3)
    colors: wp.array2d[wp.uint8],  # (N, 3)
):
    y, part = wp.tid()
    width = (points.shape[1] + starts.shape[1] - 1) // starts.shape[1]
    i = starts[y, part]
    for x in range(part * width, wp.min((part + 1) * width, points.shape[1])):
        if is_kept(points, mask, y, x):
            for k in range(3):
                cloud[i, k] = points[y, x, k]
                colors[i, k] = image[y, x, wp.min(k, image.shape[2] - 1)]
            i += 1
