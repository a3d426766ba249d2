"""Frames of a point cloud from a camera that swings around it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._checks import check_image, check_integer, check_number, check_positive
from cvkern._runtime import runtime
from cvkern.clouds.ply import check_cloud
from cvkern.images._overlay import check_color

SAMPLES = 2  # samples per pixel, down and across, which smooth the rims of points
INSIDE = (0.005, 0.995)  # quantiles of the directions that fit into the picture
MARGIN = 1.12  # width of the view divided by the width of the points
NARROWEST = 1e-3  # smallest width of a view, as a share of the distance
PIVOT = 0.3  # quantile of the depths at which the camera's pivot lies
NOD = 0.3  # vertical swing, as a share of the horizontal swing
COVER = (
    1.8  # side of a point over the distance to its neighbours; slanted surfaces need more than 1
)


def turntable(
    points: Any,
    colors: Any,
    *,
    shape: tuple[int, int] = (360, 480),
    frames: int = 60,
    swing: float = 20.0,
    point_size: float | None = None,
    background: Sequence[float] = (16, 17, 20),
) -> np.ndarray:
    """Draw a cloud from a camera that swings or circles around it.

    Parameters
    ----------
    points : array of shape (N, 3)
        Points, for example of :func:`cvkern.point_cloud`: x right, y down, z forward from the
        camera at the origin. Points behind this camera are not drawn.
    colors : array of shape (N, 3), uint8
        Red, green, blue.
    shape : (int, int), default (360, 480)
        Rows and columns of a frame.
    frames : int, default 60
        Number of frames. They make a loop, and the first is the view from the origin.
    swing : float, default 20.0
        Degrees to each side, in (0, 180]; with 180 the camera circles at constant speed.
    point_size : float, optional
        Side of the square of a point in the first frame, pixels, > 0. By default a size that closes
        the gaps between neighbours.
    background : (red, green, blue), default (16, 17, 20)
        In [0, 255].

    Returns
    -------
    array of shape (frames, rows, columns, 3), uint8

    Raises
    ------
    TypeError
        If `points` does not hold real numbers, or `colors` is not uint8.
    ValueError
        If a shape is wrong, a point is not finite, no point is in front of the camera, or a number
        is out of its range.

    Notes
    -----
    Of several points on a pixel, the nearest is drawn, and the first of those at the same depth.
    The pictures are the same on every device and kernel set.

    Examples
    --------
    >>> import numpy as np
    >>> from cvkern.clouds import turntable
    >>> points = np.random.default_rng(0).normal((0, 0, 9), 1, (99, 3))
    >>> turntable(points, np.full((99, 3), 255, np.uint8), frames=4).shape
    (4, 360, 480, 3)
    """
    colors = check_image(colors, name="colors")  # not None
    places, tints = check_cloud(points, colors)
    if np.shape(shape) != (2,):
        raise ValueError(f"shape must be rows and columns, got {shape}")
    height, width = (check_integer(n, "shape", 1, 2**13) for n in shape)
    count = check_integer(frames, "frames", 1, 2**12)
    swing = check_number(swing, "swing")
    if not 0 < swing <= 180:
        raise ValueError(f"swing must lie in (0, 180], got {swing:g}")
    if point_size is not None:
        point_size = check_positive(point_size, "point_size")
    behind = np.round(check_color(background, "background")).astype(np.uint8)
    seen = places[places[:, 2] > 0].astype(np.float64)
    if len(seen) == 0:
        raise ValueError(f"points must lie in front of the camera, got {len(places)} behind it")
    focal, cx, cy, pivot = _view(seen, height, width)
    if point_size is None:
        point_size = COVER * max(1.0, math.sqrt(height * width / len(seen)))
    # Samples lie between the centres of pixels, so express the lens in their grid.
    focal, (cx, cy) = SAMPLES * focal, (SAMPLES * c + 0.5 * (SAMPLES - 1) for c in (cx, cy))

    rt = runtime(points, colors)
    cloud, paint = rt.adopt(places), rt.adopt(tints, np.uint8)
    keys = rt.scratch("turntable.keys", (SAMPLES * height, SAMPLES * width), np.int64)
    image = rt.scratch("turntable.image", (height, width, 3), np.uint8)
    movie = np.empty((count, height, width, 3), np.uint8)
    for k in range(count):
        pose = rt.adopt(_pose(k / count, swing, pivot))
        rt.clouds.turntables.splat(cloud, pose, focal, cx, cy, SAMPLES * point_size, keys)
        rt.clouds.turntables.shade(keys, paint, rt.constant(behind), SAMPLES, image)
        movie[k] = rt.to_numpy(image)
    return movie


def _view(points: np.ndarray, height: int, width: int) -> tuple[float, float, float, np.ndarray]:
    """Return a focal length and principal point that show the points, and the pivot."""
    low, high = np.quantile(points[:, :2] / points[:, 2:], INSIDE, axis=0)
    spread = np.maximum(high - low, NARROWEST)
    focal = float(min(np.array([width, height]) / spread)) / MARGIN
    middle = 0.5 * (low + high)
    cx, cy = 0.5 * np.array([width - 1, height - 1]) - focal * middle
    pivot = np.quantile(points[:, 2], PIVOT) * np.array([*middle, 1.0])
    return focal, float(cx), float(cy), pivot


def _pose(turn: float, swing: float, pivot: np.ndarray) -> np.ndarray:
    """Return the pose (3, 4) of the camera at `turn`, in [0, 1), of the loop."""
    angle = 2 * np.pi * turn
    side, nod = np.deg2rad(swing) * np.array([np.sin(angle), NOD * np.sin(2 * angle)])
    if swing == 180:
        side, nod = angle, 0.0
    about_y = [[np.cos(side), 0, np.sin(side)], [0, 1, 0], [-np.sin(side), 0, np.cos(side)]]
    about_x = [[1, 0, 0], [0, np.cos(nod), -np.sin(nod)], [0, np.sin(nod), np.cos(nod)]]
    turned = np.array(about_x) @ np.array(about_y)
    return np.column_stack((turned, pivot - turned @ pivot)).astype(np.float32)
