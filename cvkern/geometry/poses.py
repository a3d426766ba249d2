"""Poses of a calibrated camera from points in space, or from a plane."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern.geometry._batches import batch_of, search_options
from cvkern.geometry._matches import gather
from cvkern.geometry._matrices import check_camera, check_matrix
from cvkern.geometry._points import check_pairs
from cvkern.geometry.robust import Explorer
from cvkern.kernels.codes.geometry import Model


class FoundPose(NamedTuple):
    """The pose of a camera that many matches support, x = R X + t."""

    rotation: np.ndarray | None
    """(3, 3) float64; None if there is no such pose."""
    translation: np.ndarray | None
    """(3,) float64, in the unit of the points."""
    inliers: Any
    """(N,) bool, in the library of the points: true for matches within the threshold."""
    cost: float
    """Sum over the different matches of min(1, squared residual over squared threshold)."""


class PlanePose(NamedTuple):
    """The pose of a camera in front of a plane, x = R (X, Y, 0) + t."""

    rotation: np.ndarray
    """(3, 3) float64; its last column is the plane's normal in camera axes."""
    translation: np.ndarray
    """(3,) float64, in the unit of the plane's coordinates."""


def find_pose(
    points3d: Any,
    points2d: Any,
    K: Any,
    threshold: float = 3.0,
    *,
    confidence: float = 0.999,
    max_trials: int = 32768,
    seed: int = 0,
) -> FoundPose:
    """Find the pose of a camera from matches between points in space and an image, with outliers.

    Like :func:`find_homography`, with samples of three matches. Each sample gives up to four poses,
    and the best are refined over their inliers. Points behind the camera are outliers.

    Parameters
    ----------
    points3d : array of shape (N, 3)
        (X, Y, Z) in the world. Matches that are not finite are outliers.
    points2d : array of shape (N, 2)
        Row and column of these points in the image.
    K : array of shape (3, 3)
        Camera matrix; it acts on (x, y, 1).
    threshold : float, default 3.0
        Largest distance of an inlier from its projected point, pixels.
    confidence, max_trials, seed : optional
        As in :func:`find_homography`.

    Returns
    -------
    FoundPose
        Named tuple of `rotation` and `translation`, x = R X + t (the inverse of a camera-to-world
        pose), `inliers` and `cost`. The pose is None if there are fewer than four inliers, or if
        chance alone explains as many.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or an option is not a number.
    ValueError
        If a shape does not match, there are more than 262144 matches, the camera matrix is not
        finite or has no inverse, arrays are on several devices, or an option is out of range.

    References
    ----------
    R. Haralick, C. Lee, K. Ottenberg and M. Nölle, "Review and analysis of solutions of the three
    point perspective pose estimation problem", IJCV 13(3), 1994.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> camera = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    >>> rng = np.random.default_rng(0)
    >>> points = rng.uniform(-1, 1, (60, 3))
    >>> q = (points + (0, 0, 5)) @ camera.T
    >>> seen = q[:, 1::-1] / q[:, 2:]  # rows, columns
    >>> seen[:20] = rng.uniform(0, 480, (20, 2))
    >>> pose = cvkern.find_pose(points, seen, camera)
    >>> (pose.translation.round(4) + 0).tolist(), int(pose.inliers.sum())
    ([0.0, 0.0, 5.0], 40)
    """
    options = search_options(threshold, confidence, max_trials, seed)
    camera = check_camera(K, "K")
    batched = batch_of([check_pairs(points3d, points2d, 3, ("points3d", "points2d"))], "points3d")
    batch = gather(batched.rt, batched.points)
    to_image = batch.to_unit[1, 0] @ camera  # from rays to scaled points
    known = np.concatenate((to_image, np.linalg.inv(to_image))).reshape(1, 18)
    explorer = Explorer(batched.rt, batch, options, known)
    matrices, marks, costs = explorer.finish(Model.POSE, explorer.explore(Model.POSE))
    fits = batched.fits(batch, matrices, marks, costs)
    cost = float(fits.costs[0])
    if np.isnan(matrices).any():
        return FoundPose(None, None, fits.inliers, cost)
    first, second, shift = matrices[0]
    rotation = np.stack((first, second, np.cross(first, second)))
    # Scaled points are s X + d.
    scale, moved = batch.to_unit[0, 0, 0, 0], np.append(batch.to_unit[0, 0, :2, 2], batch.deep[0])
    return FoundPose(rotation, (rotation @ moved + shift) / scale, fits.inliers, cost)


def pose_from_homography(H: Any, K: Any) -> PlanePose:
    """Return the pose of a camera relative to a plane, from the homography of the plane.

    Parameters
    ----------
    H : array of shape (3, 3)
        Homography that maps (X, Y, 1) on the plane to (x, y, 1) in the image, up to scale, for
        example from :func:`find_homography` with points of the plane given as (Y, X).
    K : array of shape (3, 3)
        Camera matrix.

    Returns
    -------
    PlanePose
        Named tuple of `rotation` and `translation`, x = R (X, Y, 0) + t (the inverse of a
        camera-to-world pose), with the origin of the plane in front of the camera. The rotation is
        the nearest one to K^-1 H.

    Raises
    ------
    TypeError
        If a matrix does not hold real numbers.
    ValueError
        If a shape does not match, a matrix is not finite or has no inverse, or the origin of the
        plane is beside the camera.

    References
    ----------
    Z. Zhang, "A flexible new technique for camera calibration", IEEE PAMI 22(11), 2000, section 3.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> camera = np.diag((500.0, 500.0, 1.0))
    >>> pose = cvkern.pose_from_homography([[500, 0, 1000], [0, 500, 0], [0, 0, 4]], camera)
    >>> (pose.rotation.round(6) + 0).tolist(), (pose.translation.round(6) + 0).tolist()
    ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [2.0, 0.0, 4.0])
    """
    h = check_matrix(H, (3, 3), "H")
    if np.linalg.matrix_rank(h) < 3:
        raise ValueError("H must have an inverse, got a matrix of rank below 3")
    m = np.linalg.inv(check_camera(K, "K")) @ h
    if not abs(m[2, 2]) > 1e-12 * np.linalg.norm(m[:, 2]):
        raise ValueError("H must put the origin of the plane before the camera, got it beside")
    u, s, vt = np.linalg.svd(m[:, :2] * np.sign(m[2, 2]))
    two = u[:, :2] @ vt
    rotation = np.column_stack((two, np.cross(two[:, 0], two[:, 1])))
    return PlanePose(rotation, m[:, 2] * np.sign(m[2, 2]) / s.mean())
