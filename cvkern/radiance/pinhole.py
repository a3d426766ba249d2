"""Pinhole cameras with lens distortion, in the conventions of OpenCV.

Camera axes are x right, y down, z forward. The centre of the pixel in row i and column j has the
image coordinates (x, y) = (j, i), here and in every kernel. The lens is that of
`cvkern.geometry.cameras.lens`. Poses are camera-to-world; the (rotation, translation) of geometry
is the inverse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cvkern._checks import FLOAT32_MAX, as_numbers, check_instance, check_integer, check_positive
from cvkern.geometry._matrices import nearest_rotations
from cvkern.geometry.cameras.lens import bent, straightened

MOST_SIDE = 2**15  # pixels


@dataclass(frozen=True, eq=False)
class Cameras:
    """N views of one image size: their poses, and their mapping of directions to pixels."""

    poses: np.ndarray
    """Camera to world, (N, 3, 4) float64: a rotation, and the centre of the camera.

    The (rotation, translation) of geometry, x = R w + t, is the inverse.
    """
    intrinsics: np.ndarray
    """fx, fy, cx, cy in pixels, (N, 4) float64."""
    distortion: np.ndarray
    """k1, k2, p1, p2, k3 of OpenCV's model, (N, 5) float64."""
    width: int
    """Columns of an image."""
    height: int
    """Rows of an image."""

    def __len__(self) -> int:
        return len(self.poses)

    def select(self, index: Any) -> Cameras:
        """Return some of the views: `index` is a slice, a mask or an array of numbers."""
        poses, lenses, bent = (a[index] for a in (self.poses, self.intrinsics, self.distortion))
        return Cameras(poses, lenses, bent, self.width, self.height)

    def resized(self, factor: int) -> Cameras:
        """Return the cameras of images averaged over blocks of `factor` x `factor` pixels.

        Raises
        ------
        TypeError
            If `factor` is not an integer.
        ValueError
            If it is not between 1 and the smaller side.
        """
        check_integer(factor, "factor", 1, min(self.width, self.height))
        small = self.intrinsics / factor
        small[:, 2:] += 0.5 / factor - 0.5  # pixel centres are integers in either image
        return Cameras(
            self.poses, small, self.distortion, self.width // factor, self.height // factor
        )

    def scaled(self, factor: float) -> Cameras:
        """Return the cameras of images `factor` times as large.

        Raises
        ------
        TypeError
            If `factor` is not a number.
        ValueError
            If it is not > 0 and finite.
        """
        check_positive(factor, "factor")
        width, height = (max(1, round(n * factor)) for n in (self.width, self.height))
        lens = self.intrinsics * factor
        lens[:, 2:] += 0.5 * factor - 0.5  # pixel centres are integers in either image
        return Cameras(self.poses, lens, self.distortion, width, height)


def cameras(
    poses: Any,
    intrinsics: Any,
    width: int,
    height: int,
    *,
    distortion: Any = 0.0,
) -> Cameras:
    """Check the parameters of some views, and collect them as cameras.

    Parameters
    ----------
    poses : array of shape (N, 3, 4) or (N, 4, 4)
        Camera to world, in any unit of length; axes x right, y down, z forward.
    intrinsics : array of shape (4,) or (N, 4), or matrices of shape (3, 3) or (N, 3, 3)
        fx, fy, cx, cy in pixels, for pixel centres at integers; or [[fx, 0, cx], [0, fy, cy],
        [0, 0, 1]], as of :func:`calibrate_camera`.
    width, height : int
        Size of the images, in pixels.
    distortion : array of shape (5,) or (N, 5), default 0.0
        k1, k2, p1, p2, k3 of OpenCV's lens model.

    Returns
    -------
    Cameras

    Raises
    ------
    ValueError
        If there is no view, a shape does not fit, a number is not finite, a focal length is not
        positive, a matrix has other numbers than those above, or a pose contains no rotation.

    Examples
    --------
    >>> import numpy as np
    >>> from cvkern.radiance import cameras
    >>> len(cameras(np.eye(4)[None], [50, 50, 31.5, 23.5], 64, 48))
    1
    """
    poses = as_numbers(poses, "poses")
    if poses.ndim != 3 or poses.shape[1:] not in ((3, 4), (4, 4)) or not len(poses):
        raise ValueError(f"poses must have shape (N, 3, 4) with N >= 1, got {poses.shape}")
    poses = poses[:, :3]
    count = len(poses)
    width = check_integer(width, "width", 1, MOST_SIDE)
    height = check_integer(height, "height", 1, MOST_SIDE)
    lens = _one_each(_of_matrices(intrinsics), count, 4, "intrinsics")
    bent = _one_each(distortion, count, 5, "distortion")
    if not (lens[:, :2] > 0).all():
        raise ValueError(f"intrinsics must have fx, fy > 0, got {lens[:, :2].min():g}")
    if not np.isfinite(poses).all():
        raise ValueError(f"poses must be finite, got view {np.argwhere(~np.isfinite(poses))[0, 0]}")
    turns = poses[:, :, :3]
    off = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    off = np.where(np.linalg.det(turns) > 0, off, np.inf)
    if off.max() > 1e-3:
        worst = int(off.argmax())
        raise ValueError(f"poses must have rotations, got in view {worst}: {turns[worst].tolist()}")
    turns = nearest_rotations(turns)  # because files round their numbers
    poses = np.concatenate((turns, poses[:, :, 3:]), axis=2)
    return Cameras(poses, lens, bent, width, height)


def _of_matrices(intrinsics: Any) -> np.ndarray:
    """Return fx, fy, cx, cy of camera matrices; other arrays as they are."""
    values = as_numbers(intrinsics, "intrinsics")
    if values.ndim not in (2, 3) or values.shape[-2:] != (3, 3):
        return values
    lens = np.stack([values[..., i, j] for i, j in ((0, 0), (1, 1), (0, 2), (1, 2))], axis=-1)
    rest = np.stack([values[..., i, j] for i, j in ((0, 1), (1, 0), (2, 0), (2, 1))], axis=-1)
    if rest.any() or (values[..., 2, 2] != 1).any():
        raise ValueError(
            "intrinsics must be matrices [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "
            f"got {values.tolist()}"
        )
    return lens


def _one_each(values: Any, count: int, size: int, name: str) -> np.ndarray:
    """Return `values`, one row for each of `count` views."""
    values = as_numbers(values, name)
    if values.ndim > 2 or (values.ndim and values.shape[-1] != size):
        raise ValueError(f"{name} must have shape ({size},) or (N, {size}), got {values.shape}")
    if values.ndim == 2 and len(values) != count:
        raise ValueError(f"{name} must have one row for each of {count} views, got {len(values)}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name} must be finite, got {values.tolist()}")
    return np.broadcast_to(values, (count, size)).copy()


def look_at(eyes: Any, targets: Any, up: Any = (0.0, 0.0, 1.0)) -> np.ndarray:
    """Return the poses of cameras that stand at `eyes` and look at `targets`.

    Parameters
    ----------
    eyes, targets : array of shape (3,) or (N, 3)
        World positions.
    up : array of shape (3,), default (0, 0, 1)
        The world's upward direction.

    Returns
    -------
    array of shape (N, 3, 4), float64

    Raises
    ------
    ValueError
        If an eye is at its target, or looks along `up`, or the shapes do not match.
    """
    up = as_numbers(up, "up")
    places = [np.atleast_2d(as_numbers(a, n)) for a, n in ((eyes, "eyes"), (targets, "targets"))]
    shapes = [place.shape for place in places]
    if up.shape != (3,) or any(len(s) != 2 or s[1] != 3 or not s[0] for s in shapes):
        got = f"{shapes[0]}, {shapes[1]} and {up.shape}"
        raise ValueError(f"eyes and targets must have shape (N, 3), and up (3,), got {got}")
    if shapes[0][0] != shapes[1][0] and 1 not in (shapes[0][0], shapes[1][0]):
        raise ValueError(f"targets must be as many as eyes, {shapes[0][0]}, got {shapes[1][0]}")
    if not all((np.abs(place) <= FLOAT32_MAX).all() for place in (*places, up)):
        raise ValueError("eyes, targets and up must be finite in float32, got others")
    eyes, targets = np.broadcast_arrays(*places)
    forward = targets - eyes
    right = np.cross(forward, up)
    length = np.linalg.norm(right, axis=1, keepdims=True)
    if not (length > 1e-9 * np.linalg.norm(forward, axis=1, keepdims=True)).all():
        raise ValueError("eyes must be apart from their targets, and not look along up")
    right = right / length
    forward = forward / np.linalg.norm(forward, axis=1, keepdims=True)
    return np.stack((right, np.cross(forward, right), forward, eyes), axis=2)


def pixel_rays(cameras: Cameras, view: int, pixels: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the origins and unit directions of the rays through `pixels` of a view.

    Parameters
    ----------
    cameras : Cameras
    view : int
    pixels : array of shape (N, 2)
        Row and column; fractions are allowed.

    Returns
    -------
    origins, directions : array of shape (N, 3), float64

    Raises
    ------
    TypeError
        If `view` is not an integer.
    ValueError
        If there is no such view, or `pixels` have another shape.
    """
    check_instance(cameras, Cameras, "cameras")
    view = check_integer(view, "view", 0, len(cameras) - 1)
    pixels = _rows(pixels, 2, "pixels")
    fx, fy, cx, cy = cameras.intrinsics[view]
    shown = np.stack(((pixels[:, 1] - cx) / fx, (pixels[:, 0] - cy) / fy), axis=1)
    pose = cameras.poses[view]
    with np.errstate(all="ignore"):  # pixels may be anywhere
        straight = straightened(shown, cameras.distortion[view])
        ahead = np.concatenate((straight, np.ones((len(straight), 1))), axis=1)
        directions = ahead @ pose[:, :3].T
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.broadcast_to(pose[:, 3], directions.shape), directions


def project(cameras: Cameras, view: int, points: Any) -> np.ndarray:
    """Return row and column of world points in a view; NaN for points behind the camera.

    Parameters
    ----------
    cameras : Cameras
    view : int
    points : array of shape (N, 3)

    Returns
    -------
    array of shape (N, 2), float64

    Raises
    ------
    TypeError
        If `view` is not an integer.
    ValueError
        If there is no such view, or `points` have another shape.
    """
    check_instance(cameras, Cameras, "cameras")
    view = check_integer(view, "view", 0, len(cameras) - 1)
    pose = cameras.poses[view]
    points = _rows(points, 3, "points")
    fx, fy, cx, cy = cameras.intrinsics[view]
    with np.errstate(all="ignore"):  # points may be anywhere, and nowhere
        seen = (points - pose[:, 3]) @ pose[:, :3]
        depth = np.where(seen[:, 2:] > 0, seen[:, 2:], np.nan)
        shown = bent(seen[:, :2] / depth, cameras.distortion[view])
    return np.stack((fy * shown[:, 1] + cy, fx * shown[:, 0] + cx), axis=1)


def _rows(values: Any, size: int, name: str) -> np.ndarray:
    """Return `values` as (N, size) float64."""
    found = as_numbers(values, name)
    if found.ndim != 2 or found.shape[1] != size:
        raise ValueError(f"{name} must have shape (N, {size}), got {found.shape}")
    return found
