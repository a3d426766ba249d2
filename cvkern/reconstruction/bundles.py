"""Bundle adjustment of given cameras and points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import (
    as_array,
    as_items,
    as_numbers,
    check_choice,
    check_integer,
    check_positive,
)
from cvkern._runtime import refuse_capture
from cvkern.geometry._matrices import nearest_rotations
from cvkern.geometry._points import check_points
from cvkern.geometry.cameras.lens import Camera, check_lens, matrix_of
from cvkern.kernels.codes.reconstruction import POSE, Loss
from cvkern.reconstruction._adjustment import Bundle, Effort, adjust, lens_row

LOSSES = {"squared": Loss.SQUARED, "huber": Loss.HUBER, "cauchy": Loss.CAUCHY}
# What of the lenses may change, and the parameters of a view.
FREE = {"none": POSE, "focal": POSE + 1, "distortion": POSE + 3, "all": POSE + 5}
MOST_VIEWS = 2000  # the equations of the views are dense


class AdjustedBundle(NamedTuple):
    """Cameras and points after bundle adjustment."""

    poses: np.ndarray
    """Camera to world, (N, 3, 4) float64."""
    lenses: tuple[Camera, ...]
    points: np.ndarray
    """(P, 3) float64."""
    errors: np.ndarray
    """Distance of each place from its projected point, (O,) float64, pixels; 1414 for points behind
    a camera."""


def adjust_bundle(
    poses: Any,
    lenses: Camera | Sequence[Camera],
    points: Any,
    tracks: Any,
    places: Any,
    *,
    lens_of: Any = None,
    fixed: Any = None,
    refine: str = "none",
    loss: str = "huber",
    scale: float = 2.0,
    max_steps: int = 50,
) -> AdjustedBundle:
    """Adjust cameras and points so that the points project to where they were seen.

    Parameters
    ----------
    poses : array of shape (N, 3, 4)
        Camera to world, in any unit of length; axes x right, y down, z forward. At most 2000.
    lenses : Camera or sequence of Camera
        The camera of all photographs, or several, which `lens_of` assigns.
    points : array of shape (P, 3)
        Points of the world.
    tracks : array of shape (O, 2), integer
        The point and the photograph of each sighting, in any order, each pair once.
    places : array of shape (O, 2)
        Row and column of each sighting in its photograph.
    lens_of : array of shape (N,), integer, optional
        The lens of each photograph; by default the first of all, or, of as many lenses as
        photographs, its own.
    fixed : array of shape (N,), bool, optional
        Photographs whose poses, and whose lenses, stay. By default the pose of the first stays.
    refine : {'none', 'focal', 'distortion', 'all'}, default 'none'
        What of the lenses changes: nothing; the focal length (both keep their ratio); also k1 and
        k2; also the principal point.
    loss : {'huber', 'squared', 'cauchy'}, default 'huber'
        How the cost grows with the distance: the latter two grow more slowly beyond `scale`.
    scale : float, default 2.0
        Pixels at which the loss begins to differ from squares.
    max_steps : int, default 50
        Largest number of steps; fewer if the cost falls by less than 1e-7 of itself.

    Returns
    -------
    AdjustedBundle
        Named tuple of `poses`, `lenses`, `points` and `errors`.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or indices are not integers.
    ValueError
        If a shape does not match, a number is not finite, an index is out of range, a point is
        seen twice in a photograph, a pose contains no rotation, or an option is unknown.

    Notes
    -----
    Levenberg-Marquardt steps with analytic derivatives. Points are eliminated, by Schur's
    complement, and Cholesky's method solves the dense equations of the cameras. Robust losses
    weigh squares anew in each step. All numbers are float64, and all sums have one order. Nothing
    fixes the unit of length: the cost does not depend on it.

    References
    ----------
    B. Triggs, P. McLauchlan, R. Hartley and A. Fitzgibbon, "Bundle adjustment: a modern synthesis",
    Vision Algorithms, LNCS 1883, 2000.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> camera = cvkern.Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], shape=(480, 640))
    >>> rng = np.random.default_rng(0)
    >>> points = rng.uniform((-1, -1, 4), (1, 1, 8), (30, 3))
    >>> poses = np.stack([np.eye(3, 4)] * 3)
    >>> poses[1:, 0, 3] = 0.5, 1.0
    >>> seen = [cvkern.project_points(points - pose[:, 3], camera) for pose in poses]
    >>> tracks = np.array([(p, n) for n in range(3) for p in range(30)])
    >>> moved = points + rng.normal(0, 0.05, points.shape)
    >>> found = cvkern.adjust_bundle(poses, camera, moved, tracks, np.concatenate(seen))
    >>> bool(found.errors.max() < 1e-3)
    True
    """
    refuse_capture("adjust_bundle")
    check_choice(refine, tuple(FREE), "refine")
    check_choice(loss, tuple(LOSSES), "loss")
    scale = check_positive(scale, "scale")
    steps = check_integer(max_steps, "max_steps", 0, 2**31 - 1)
    given = _check_poses(poses)
    count = len(given)
    kinds = [lenses] if isinstance(lenses, Camera) else as_items(lenses, "lenses", "cameras")
    if not kinds:
        raise ValueError("lenses must not be empty, got none")
    kinds = [check_lens(camera, f"lenses[{i}]") for i, camera in enumerate(kinds)]
    if lens_of is None:
        if len(kinds) not in (1, count):
            raise ValueError(f"lenses must be one, or {count} without lens_of, got {len(kinds)}")
        of = np.arange(count) % len(kinds)
    else:
        of = _indices(lens_of, (count,), len(kinds), "lens_of")
    scene = np.asarray(as_numbers(check_points(points, "points", 3), "points"), np.float64)
    where = np.asarray(as_numbers(check_points(places, "places"), "places"), np.float64)
    for values, name in ((scene, "points"), (where, "places")):
        if not np.isfinite(values).all():
            raise ValueError(f"{name} must be finite, got some that are not")
    limits = np.array([len(scene), count])
    seen = _indices(tracks, (len(where), 2), limits, "tracks")
    key = seen @ np.array([count, 1])
    order = np.arange(len(key))
    if (np.diff(key) <= 0).any():
        order = np.argsort(key, kind="stable")
        if (np.diff(key[order]) == 0).any():
            raise ValueError("tracks must have each point of a photograph once, got one twice")
    still = None
    if fixed is not None:
        still = np.asarray(as_array(fixed, "fixed"))
        if still.shape != (count,) or still.dtype != bool:
            raise ValueError(f"fixed must be bool of shape ({count},), got {still.dtype}")
    turns = given[:, :, :3].transpose(0, 2, 1)
    bundle = Bundle(
        turns, -np.einsum("nij,nj->ni", turns, given[:, :, 3]),
        np.stack([lens_row(camera) for camera in kinds]), of, scene, seen[order][:, ::-1],
        np.ascontiguousarray(where[order][:, ::-1]),
    )  # fmt: skip
    bundle, gaps = adjust(bundle, Effort(FREE[refine], LOSSES[loss], scale, steps), still)
    errors = np.empty(len(order))
    errors[order] = np.linalg.norm(gaps, axis=1)
    back = bundle.rotations.transpose(0, 2, 1)
    eyes = -np.einsum("nij,nj->ni", back, bundle.translations)
    made = []
    for row, camera in zip(bundle.lenses, kinds, strict=True):
        made.append(Camera(matrix_of(*row[:4]), row[4:], camera.shape))
    adjusted = np.concatenate((back, eyes[:, :, None]), axis=2)
    return AdjustedBundle(adjusted, tuple(made), bundle.points, errors)


def _check_poses(poses: Any) -> np.ndarray:
    given = as_numbers(poses, "poses")
    if given.ndim != 3 or given.shape[1:] not in ((3, 4), (4, 4)) or not len(given):
        raise ValueError(f"poses must have shape (N, 3, 4) with N >= 1, got {given.shape}")
    check_integer(len(given), "the number of poses", 1, MOST_VIEWS)
    given = given[:, :3]
    if not np.isfinite(given).all():
        raise ValueError("poses must be finite, got some that are not")
    turns = given[:, :, :3]
    off = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = np.flatnonzero((off > 1e-3) | (np.linalg.det(turns) < 0))
    if len(wrong):
        raise ValueError(f"poses must have rotations, got in view {wrong[0]} another matrix")
    return np.concatenate((nearest_rotations(turns), given[:, :, 3:]), axis=2)


def _indices(values: Any, shape: tuple[int, ...], limit: Any, name: str) -> np.ndarray:
    found = np.asarray(as_array(values, name))
    found = np.zeros(shape, int) if not found.size and 0 in shape else found
    if found.dtype.kind not in "iu":
        raise TypeError(f"{name} must be integers, got {found.dtype}")
    if found.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {found.shape}")
    if found.size and (found.min() < 0 or (found >= limit).any()):
        raise ValueError(f"{name} must be indices that exist, got others")
    return found.astype(np.int64)
