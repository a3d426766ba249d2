"""Pictures of point clouds, in Warp: an integer minimum decides which point is visible.

A point is a square in the view of a pinhole camera. Its key has the depth in the higher bits and
the number of the point in the lower bits; each sample keeps the smallest key that falls on it. One
thread per point draws; then one thread per pixel averages its samples.
"""

import warp as wp

from cvkern.kernels.codes.clouds import FAR, LARGEST_SPLAT
from cvkern.kernels.warp._launch import launch

# Without fused multiply-add a point falls on the same pixels on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

NOTHING = wp.constant(wp.int64(FAR))
LARGEST = wp.constant(LARGEST_SPLAT)


@wp.kernel
def _clear(
    # outputs
    keys: wp.array[wp.int64],
):
    keys[wp.tid()] = NOTHING


@wp.func
def moved(pose: wp.array2d[float], row: int, x: float, y: float, z: float) -> float:
    """Return one coordinate of a point in the camera at `pose`."""
    return pose[row, 0] * x + pose[row, 1] * y + pose[row, 2] * z + pose[row, 3]


@wp.func
def first_sample(middle: float, half: float) -> int:
    """Return the first sample whose centre a square covers, or the nearest if it covers none."""
    first = wp.ceil(middle - half)
    return int(wp.where(first < middle + half, first, wp.floor(middle + 0.5)))


@wp.kernel
def _splat(
    points: wp.array2d[float],  # (N, 3)
    pose: wp.array2d[float],  # (3, 4)
    focal: float,
    cx: float,
    cy: float,
    size: float,
    # outputs
    keys: wp.array2d[wp.int64],  # (H, W)
):
    i = wp.tid()
    x = points[i, 0]
    y = points[i, 1]
    z = points[i, 2]
    depth = moved(pose, 2, x, y, z)
    if not (z > 0.0 and depth > 0.0):
        return
    u = moved(pose, 0, x, y, z) / depth * focal + cx
    v = moved(pose, 1, x, y, z) / depth * focal + cy
    half = 0.5 * wp.min(z / depth * size, LARGEST)
    if not (
        u + half > -0.5
        and v + half > -0.5
        and u - half < float(keys.shape[1]) + 0.5
        and v - half < float(keys.shape[0]) + 0.5
    ):
        return
    left = first_sample(u, half)
    top = first_sample(v, half)
    right = wp.max(int(wp.ceil(u + half)), left + 1)
    bottom = wp.max(int(wp.ceil(v + half)), top + 1)
    # Bits of positive floats have the order of their values; a tie shows the first point.
    key = (wp.int64(wp.cast(depth, wp.int32)) << wp.int64(32)) | wp.int64(i)
    for row in range(wp.max(top, 0), wp.min(bottom, keys.shape[0])):
        for column in range(wp.max(left, 0), wp.min(right, keys.shape[1])):
            wp.atomic_min(keys, row, column, key)


@wp.kernel
def _shade(
    keys: wp.array2d[wp.int64],  # (samples H, samples W)
    colors: wp.array2d[wp.uint8],  # (N, 3)
    background: wp.array[wp.uint8],  # (3,)
    samples: int,
    # outputs
    image: wp.array3d[wp.uint8],  # (H, W, 3)
):
    pixel = wp.tid()
    y = pixel // image.shape[1]
    x = pixel - y * image.shape[1]
    count = samples * samples
    for k in range(3):
        total = int(0)
        for s in range(count):
            key = keys[y * samples + s // samples, x * samples + s % samples]
            if key == NOTHING:
                total += int(background[k])
            else:
                total += int(colors[int(key & wp.int64(0x7FFFFFFF)), k])
        image[y, x, k] = wp.uint8((2 * total + count) // (2 * count))


def splat(
    points: wp.array,
    pose: wp.array,
    focal: float,
    cx: float,
    cy: float,
    size: float,
    keys: wp.array,
) -> None:
    """Write the key of the nearest point of each sample, or FAR; one thread per point.

    A point is a square of `size` samples in the view of the camera at the origin. In the view of
    the camera at `pose`, its size is in inverse proportion to its depth. Points behind either
    camera are not drawn.
    """
    flat = (keys.size,)
    launch(_clear, flat, [], [keys.reshape(flat)])
    launch(_splat, points.shape[0], [points, pose, focal, cx, cy, size], [keys])


def shade(
    keys: wp.array, colors: wp.array, background: wp.array, samples: int, image: wp.array
) -> None:
    """Average the colours of the samples of each pixel; one thread per pixel."""
    pixels = image.shape[0] * image.shape[1]
    launch(_shade, pixels, [keys, colors, background, samples], [image])
