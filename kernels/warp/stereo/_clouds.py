"""Points of a map collected into clouds, on both devices: one thread per part of a row.

The points of each part are counted first; a prefix sum of the counts gives the place of each part.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})


@wp.func
def is_kept(points: wp.array3d[float], mask: wp.array2d[wp.uint8], y: int, x: int) -> bool:
    """Tell whether a pixel has a finite point and is set in the mask, if there is a mask."""
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
