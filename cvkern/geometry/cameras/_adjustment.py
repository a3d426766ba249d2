"""Least squares over cameras and the poses of views, by the Levenberg-Marquardt method.

The poses of different views are not coupled. Each pose is eliminated on its own (Schur complement),
which leaves equations in the parameters that all views share. For a hundred views an iteration
takes milliseconds; a dense solver, such as SciPy's, takes seconds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cvkern.geometry.cameras.lens import bent, slopes, turned

MOST_STEPS = 100
ENOUGH = 1e-12  # the steps end when the relative decrease of the cost is below this
FIRST_DAMPING, MOST_DAMPING = 1e-4, 1e12


class Poses(NamedTuple):
    """Poses of a board relative to a camera, one for each view: X = R W + t."""

    rotations: np.ndarray  # (V, 3, 3)
    translations: np.ndarray  # (V, 3)


class Residuals(NamedTuple):
    """Residuals of points, and their derivatives."""

    off: np.ndarray  # (M, 2), x and y in pixels
    shared: np.ndarray  # (M, 2, S), with respect to shared parameters
    pose: np.ndarray  # (M, 2, 6), for a turn about the camera axes, and for the translation


class Adjusted(NamedTuple):
    """The result of the least squares."""

    shared: np.ndarray
    poses: Poses
    residuals: Residuals
    deviations: np.ndarray  # (S,), standard deviations of the shared parameters


Evaluate = Callable[[np.ndarray, Poses], Residuals]
Move = Callable[[np.ndarray, np.ndarray], np.ndarray]


def adjust(
    evaluate: Evaluate, move: Move, shared: np.ndarray, poses: Poses, views: np.ndarray,
    free: np.ndarray,
) -> Adjusted:  # fmt: skip
    """Minimise the sum of squares.

    `views` (M,) rises and says of which view a point is. `free` says which of the shared numbers
    may change, and `move` returns them after a step.
    """
    begins = np.flatnonzero(np.diff(views, prepend=-1))
    found = evaluate(shared, poses)
    cost = _cost(found)
    if not np.isfinite(cost):  # a point is behind the camera, and no derivative leads it out
        raise np.linalg.LinAlgError("no finite solution")
    damping = FIRST_DAMPING
    for _ in range(MOST_STEPS):
        step, turns, equations = _step(found, begins, free, damping)
        tried = move(shared, step)
        moved = Poses(
            np.stack([turned(w) @ r for w, r in zip(turns[:, :3], poses.rotations, strict=True)]),
            poses.translations + turns[:, 3:],
        )
        new = evaluate(tried, moved)
        lower = _cost(new)
        if lower <= cost:
            gain, cost = cost - lower, lower
            shared, poses, found = tried, moved, new
            damping = max(damping / 10, 1e-15)
            if gain <= ENOUGH * cost:
                break
        else:
            damping *= 10
            if damping > MOST_DAMPING:
                break
    equations = _step(found, begins, free, 0.0)[2]
    unknowns = int(free.sum()) + 6 * len(begins)
    spread = cost / max(1, 2 * len(views) - unknowns)
    deviations = np.zeros(len(free))
    deviations[free] = np.sqrt(np.maximum(np.diag(np.linalg.pinv(equations)), 0) * spread)
    return Adjusted(shared, poses, found, deviations)


def _cost(found: Residuals) -> float:
    cost = float(np.sum(found.off**2))
    return cost if np.isfinite(cost) else np.inf


def _step(
    found: Residuals, begins: np.ndarray, free: np.ndarray, damping: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a step of the shared numbers, of the poses, and the equations of the shared ones."""
    by_shared = found.shared[..., free]
    flat = by_shared.reshape(2 * len(found.off), int(free.sum()))
    off = found.off
    u = flat.T @ flat
    g = -flat.T @ off.ravel()

    def per_view(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.add.reduceat(one.transpose(0, 2, 1) @ other, begins)

    v = per_view(found.pose, found.pose)  # (V, 6, 6)
    w = per_view(by_shared, found.pose)  # (V, S, 6)
    h = -per_view(found.pose, off[..., None])[..., 0]  # (V, 6)
    u = u + damping * np.diag(np.diag(u))
    v = v + damping * v * np.eye(6)
    solved = np.linalg.solve(v, np.concatenate((w.transpose(0, 2, 1), h[..., None]), axis=2))
    equations = u - np.einsum("vsi,vit->st", w, solved[..., :-1])
    right = g - np.einsum("vsi,vi->s", w, solved[..., -1])
    step = np.zeros(len(free))
    if free.any():
        step[free] = np.linalg.lstsq(equations, right, rcond=1e-15)[0]
    turns = solved[..., -1] - solved[..., :-1] @ step[free]
    return step, turns, equations


class Projected(NamedTuple):
    """Projected points, and the derivatives of the projection."""

    places: np.ndarray  # (M, 2), x and y
    by_point: np.ndarray  # (M, 2, 3)
    by_camera: np.ndarray  # (M, 2, 9): fx, fy, cx, cy, k1, k2, p1, p2, k3


def projected(points: np.ndarray, numbers: np.ndarray) -> Projected:
    """Project points (M, 3) in camera axes by nine camera numbers; NaN for points behind it."""
    fx, fy, cx, cy = numbers[:4]
    depth = np.where(points[:, 2] > 0, points[:, 2], np.nan)
    x, y = points[:, 0] / depth, points[:, 1] / depth
    r2 = x * x + y * y
    bent_x, bent_y = bent(np.stack((x, y), axis=1), numbers[4:]).T
    xx, xy, yy = slopes(x, y, numbers[4:])
    zero, one = np.zeros_like(x), np.ones_like(x)
    by_point = (
        np.stack(
            (
                np.stack((fx * xx, fx * xy, -fx * (xx * x + xy * y)), axis=1),
                np.stack((fy * xy, fy * yy, -fy * (xy * x + yy * y)), axis=1),
            ),
            axis=1,
        )
        / depth[:, None, None]
    )
    by_x = (bent_x, zero, one, zero, fx * x * r2, fx * x * r2**2, 2 * fx * x * y,
            fx * (r2 + 2 * x * x), fx * x * r2**3)  # fmt: skip
    by_y = (zero, bent_y, zero, one, fy * y * r2, fy * y * r2**2, fy * (r2 + 2 * y * y),
            2 * fy * x * y, fy * y * r2**3)  # fmt: skip
    by_camera = np.stack((np.stack(by_x, axis=1), np.stack(by_y, axis=1)), axis=1)
    places = np.stack((fx * bent_x + cx, fy * bent_y + cy), axis=1)
    return Projected(places, by_point, by_camera)


def crossed(points: np.ndarray) -> np.ndarray:
    """Return the derivative of points (M, 3) for a small turn: minus their cross matrices."""
    x, y, z = points.T
    zero = np.zeros_like(x)
    rows = ((zero, z, -y), (-z, zero, x), (y, -x, zero))
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)
