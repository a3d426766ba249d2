"""Two or more calibrated views: essential matrices, relative poses, triangulated points."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_image
from cvkern._runtime import runtime
from cvkern.geometry._matrices import check_camera, check_matrix
from cvkern.geometry._points import check_pairs, on_host, xy
from cvkern.geometry.essential import equalised

STEPS = 10  # Gauss-Newton steps: noise of some pixels needs four


class RecoveredPose(NamedTuple):
    """The pose of the second camera relative to the first, x1 = R x0 + t."""

    rotation: np.ndarray
    """(3, 3) float64."""
    translation: np.ndarray
    """(3,) float64, of length 1: matches alone do not determine the scale."""
    inliers: Any
    """(N,) bool, in the library of the points: true for matches in front of both cameras."""


def essential_from_fundamental(matrix: Any, K0: Any, K1: Any) -> np.ndarray:
    """Return the essential matrix of a fundamental matrix and two cameras.

    Parameters
    ----------
    matrix : array of shape (3, 3)
        Fundamental matrix, x1' F x0 = 0 with (x, y, 1).
    K0, K1 : array of shape (3, 3)
        Camera matrices of the first and of the second image.

    Returns
    -------
    numpy.ndarray of shape (3, 3), float64
        The nearest matrix to K1' F K0, up to scale, with singular values 1, 1 and 0.

    Raises
    ------
    TypeError
        If a matrix does not hold real numbers.
    ValueError
        If a shape does not match, a matrix is not finite, or a camera matrix has no inverse.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> rectified = [[0, 0, 0], [0, 0, -1], [0, 1, 0]]
    >>> abs(cvkern.essential_from_fundamental(rectified, np.eye(3), np.eye(3))).tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
    """
    f = check_matrix(matrix, (3, 3), "matrix")
    return equalised(check_camera(K1, "K1").T @ f @ check_camera(K0, "K0"))


def recover_pose(E: Any, points0: Any, points1: Any, K0: Any, K1: Any) -> RecoveredPose:
    """Find the pose of the second camera from an essential matrix and matches.

    An essential matrix has four poses. The result is the one with most points in front of both
    cameras.

    Parameters
    ----------
    E : array of shape (3, 3)
        Essential matrix, for example from :func:`essential_from_fundamental`.
    points0 : array of shape (N, 2)
        Row and column in the first image; N >= 1. Most of them should be inliers.
    points1 : array of shape (N, 2)
        Row and column of the same points in the second image.
    K0, K1 : array of shape (3, 3)
        Camera matrices of the first and of the second image.

    Returns
    -------
    RecoveredPose
        Named tuple of `rotation` and `translation`, x1 = R x0 + t (the inverse of a camera-to-world
        pose where the first camera is the world), and `inliers`.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If a shape does not match, a matrix is not finite, a camera matrix has no inverse, or no
        match is in front of both cameras in any pose.

    References
    ----------
    R. Hartley and A. Zisserman, "Multiple View Geometry in Computer Vision", 2nd edition, 2004,
    section 9.6.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> camera = np.diag((500.0, 500.0, 1.0))
    >>> scene = np.random.default_rng(0).uniform((-1, -1, 4), (1, 1, 8), (20, 3))
    >>> def seen(points):
    ...     return 500 * points[:, 1::-1] / points[:, 2:]  # rows, columns
    >>> moved = scene + (1, 0, 0)
    >>> sideways = [[0, 0, 0], [0, 0, -1], [0, 1, 0]]
    >>> pose = cvkern.recover_pose(sideways, seen(scene), seen(moved), camera, camera)
    >>> (pose.rotation.round(6) + 0).tolist(), pose.translation.round(6).tolist()
    ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [1.0, 0.0, 0.0])
    """
    e = check_matrix(E, (3, 3), "E")
    points0, points1 = check_pairs(points0, points1)
    rt = runtime(points0, points1)
    inverse = [np.linalg.inv(check_camera(k, name)) for k, name in ((K0, "K0"), (K1, "K1"))]
    with np.errstate(all="ignore"):  # points may be at infinity
        a, b = (
            np.c_[xy(on_host(rt, p)), np.ones(len(p))] @ to_ray.T
            for p, to_ray in zip((points0, points1), inverse, strict=True)
        )
    u, _, vt = np.linalg.svd(e)
    u, vt = u * np.sign(np.linalg.det(u)), vt * np.sign(np.linalg.det(vt))
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    best = None
    for w in (turn, turn.T):
        rotation = u @ w @ vt
        for translation in (u[:, 2], -u[:, 2]):
            front = _in_front(a, b, rotation, translation)
            if best is None or front.sum() > best[2].sum():
                best = rotation, translation, front
    assert best is not None
    if not best[2].any():
        raise ValueError("points0 and points1 must be in front of both cameras, got none that is")
    return RecoveredPose(best[0], best[1], rt.give(best[2]))


def _in_front(a: np.ndarray, b: np.ndarray, rotation: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Tell which rays (x, y, 1) meet in front: z1 b = z0 R a + t, in least squares of z0, z1."""
    with np.errstate(all="ignore"):  # rays may have any slope
        c = a @ rotation.T
        cc, cb, bb = (c * c).sum(1), (c * b).sum(1), (b * b).sum(1)
        ct, bt = c @ t, b @ t
        # The determinant of the equations is not negative.
        return (cb * bt - bb * ct > 0) & (cc * bt - cb * ct > 0)


def triangulate(matrices: Any, points: Any) -> np.ndarray:
    """Triangulate points in space from their positions in several views.

    Gauss-Newton steps from the linear solution find the nearest minimum of the sum of squared
    distances between the given and the projected points, for two or more views.

    Parameters
    ----------
    matrices : array of shape (V, 3, 4)
        Projections, K (R | t), of V >= 2 views: they act on (X, Y, Z, 1).
    points : array of shape (V, N, 2)
        Row and column of each point in each view. NaN where a view does not see a point.

    Returns
    -------
    numpy.ndarray of shape (N, 3), float64
        (X, Y, Z). NaN for points that fewer than two views see; infinite or very far where the
        rays are parallel.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If a shape does not match, a matrix is not finite, or there are fewer than two views.

    References
    ----------
    R. Hartley and P. Sturm, "Triangulation", CVIU 68(2), 1997.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> left = np.eye(3, 4)
    >>> right = left - [[0, 0, 0, 1], [0, 0, 0, 0], [0, 0, 0, 0]]
    >>> cvkern.triangulate([left, right], [[[0.5, 0.75]], [[0.5, 0.5]]]).round(6).tolist()
    [[3.0, 2.0, 4.0]]
    """
    p = check_matrix(matrices, (-1, 3, 4), "matrices")
    points = check_image(points, ndim=(3,), name="points")
    shape = tuple(points.shape)
    if len(p) < 2 or shape[0] != len(p) or shape[2] != 2:
        raise ValueError(
            f"points must have shape (V, N, 2) with V >= 2 as matrices have, {len(p)}, got {shape}"
        )
    seen = on_host(runtime(points), points)[..., ::-1]  # x, y
    known = np.asarray(np.isfinite(seen).all(axis=2))
    seen = np.where(known[..., None], seen, 0.0)
    # Rows of the linear equations, each scaled to a length of 1.
    rows = seen[..., None] * p[:, None, 2:3] - p[:, None, :2]
    rows /= np.linalg.norm(rows, axis=3, keepdims=True)
    rows = (rows * known[..., None, None]).transpose(1, 0, 2, 3).reshape(shape[1], -1, 4)
    enough = known.sum(axis=0) >= 2
    found = np.full((shape[1], 3), np.nan)
    if enough.any():
        homogeneous = np.linalg.svd(rows[enough], full_matrices=False)[2][:, 3]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            start = homogeneous[:, :3] / homogeneous[:, 3:]
        found[enough] = _refined(p, seen[:, enough], known[:, enough], start)
    return found


def _refined(p: np.ndarray, seen: np.ndarray, known: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Take Gauss-Newton steps that lower the sum of squared distances; (N, 3)."""

    def gaps(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        q = np.einsum("vij,nj->vni", p[..., :3], x) + p[:, None, :, 3]
        gap = (q[..., :2] / q[..., 2:] - seen) * known[..., None]
        return q, gap, (gap**2).sum(axis=(0, 2))

    with np.errstate(all="ignore"):
        q, gap, cost = gaps(x)
        for _ in range(STEPS):
            slope = p[:, None, :2, :3] - (q[..., :2] / q[..., 2:])[..., None] * p[:, None, 2:3, :3]
            slope = slope / q[..., 2:, None] * known[..., None, None]
            normal = np.einsum("vnki,vnkj->nij", slope, slope)
            # An infinite point, whose equations have no solution, stays.
            singular = ~(np.abs(np.linalg.det(normal)) > 0)
            singular |= ~np.isfinite(normal).all(axis=(1, 2))
            normal[singular] = np.eye(3)
            step = np.linalg.solve(normal, np.einsum("vnki,vnk->ni", slope, gap)[..., None])[..., 0]
            trial = np.where(singular[:, None], x, x - step)
            q2, gap2, cost2 = gaps(trial)
            better = np.asarray(cost2 < cost)
            x = np.where(better[:, None], trial, x)
            cost = np.where(better, cost2, cost)
            q = np.where(better[None, :, None], q2, q)
            gap = np.where(better[None, :, None], gap2, gap)
    return x
