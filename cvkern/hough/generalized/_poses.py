"""From votes to poses: the best cells of an accumulator, fitted to the edges and judged by them.

The host does this for the few poses with most votes. A pose is (row, column, rotation, scale),
float64.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cvkern.kernels.codes.hough import DIRECTIONS

REACH = 1  # pixels: largest distance of an edge that supports an entry of the table
SEARCH = 6  # pixels: the same before a pose is fitted, when only its cell and bins are known
BEND = math.radians(7)  # largest angle between the gradient and the direction in the table
SAMPLE = 128  # entries used for the first judgement of a pose
ROUNDS = 4  # fits of a pose to all its points
SAME = 2.0, math.radians(2), 1.03  # pixels, radians, ratio: closer poses are the same


class Scene(NamedTuple):
    """Edge points of an image."""

    points: np.ndarray
    """Row and column, (N, 2) int32, in raster order."""
    codes: np.ndarray
    """Codes of their directions, (N,) int32."""
    shape: tuple[int, int]


class Model(NamedTuple):
    """A table in float64."""

    vectors: np.ndarray
    """Vectors from the boundary points to the reference point, (M, 2)."""
    orientation: np.ndarray
    """Directions of the gradient in radians, (M,)."""


def strongest(values: np.ndarray, most: int) -> np.ndarray:
    """Return the indices of the `most` largest values; the first of equal values comes first.

    Values below an eighth of the largest are left out, which saves work if one value is far above
    the others.
    """
    top = values.max()
    found = np.flatnonzero(values >= top // 2)
    for part in (4, 8):  # few values are large: the others need not be sorted
        if len(found) < most:
            found = np.flatnonzero(values >= top // part)
    if len(found) > most:
        least = np.partition(values[found], len(found) - most)[len(found) - most]
        found = found[values[found] >= least]
    return found[np.argsort(-values[found], kind="stable")][:most]


def apart(
    poses: np.ndarray, most: int, distance: float, rotation: float, ratio: float
) -> np.ndarray:
    """Return the indices of the poses that are close to no better pose, the best first.

    Two poses are close if they are less than `distance` apart, their rotations differ by less than
    `rotation`, and their scales by less than the factor `ratio`. `poses` are sorted, best first.
    """
    left = np.ones(len(poses), bool)
    kept: list[int] = []
    logs = np.log(poses[:, 3])
    for i in range(len(poses)):
        if not left[i]:
            continue
        kept.append(i)
        if len(kept) >= most:
            break
        away = np.hypot(*(poses[:, :2] - poses[i, :2]).T)
        turned = np.abs((poses[:, 2] - poses[i, 2] + math.pi) % (2 * math.pi) - math.pi)
        near = (away < distance) & (turned <= rotation)
        left &= ~(near & (np.abs(logs - logs[i]) <= math.log(ratio)))
    return np.array(kept, np.intp)


def placed(offsets: np.ndarray, position: np.ndarray, rotation: float, scale: float) -> np.ndarray:
    """Return the positions (M, 2) of points at `offsets` (M, 2) from the reference point."""
    cosine, sine = scale * math.cos(rotation), scale * math.sin(rotation)
    return position + offsets @ np.array([[cosine, -sine], [sine, cosine]])


class Judge:
    """Compares poses of a table with the edges of an image."""

    def __init__(self, scene: Scene, model: Model):
        self.margin = SEARCH + 2
        height, width = scene.shape
        self.limits = np.array([height, width]) + 2 * self.margin - 1
        self.codes = np.full(self.limits + 1, -1, np.int16)
        self.codes[tuple((scene.points + self.margin).T)] = scene.codes
        self.model = model

    def judged(
        self, poses: np.ndarray, every: int, reach: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Search along the normal of each `every`-th entry for an edge of the entry's direction.

        Return whether there is an edge (P, M), its distance (P, M), and the derivatives of this
        distance by scale times cosine, scale times sine, row and column (P, M, 4), for P poses and
        M entries.
        """
        u = -self.model.vectors[::every]
        rows, columns, rotation, scale = (poses[:, i, None] for i in range(4))
        a, b = scale * np.cos(rotation), scale * np.sin(rotation)
        y = rows + a * u[:, 0] + b * u[:, 1] + self.margin
        x = columns + a * u[:, 1] - b * u[:, 0] + self.margin
        angle = self.model.orientation[::every] + rotation
        ny, nx = np.sin(angle), np.cos(angle)
        wanted = np.rint(angle * (DIRECTIONS / (2 * math.pi))).astype(np.int16)
        bend = round(BEND * DIRECTIONS / (2 * math.pi))
        found = np.zeros(y.shape, bool)
        gap = np.zeros(y.shape)
        for step in sorted(range(-reach, reach + 1), key=abs):
            row = np.rint(y + step * ny).clip(0, self.limits[0]).astype(np.intp)
            column = np.rint(x + step * nx).clip(0, self.limits[1]).astype(np.intp)
            code = self.codes[row, column]
            off = (code - wanted + DIRECTIONS // 2) & (DIRECTIONS - 1)
            new = (code >= 0) & (np.abs(off - DIRECTIONS // 2) <= bend) & ~found
            gap[new] = (ny * (row - y) + nx * (column - x))[new]
            found |= new
        by = (ny * u[:, 0] + nx * u[:, 1], ny * u[:, 1] - nx * u[:, 0], ny, nx)
        return found, gap, np.stack(by, axis=2)

    def fitted(self, poses: np.ndarray, every: int, reach: int) -> np.ndarray:
        """Move poses towards the edges found, by least squares along the normals."""
        found, gap, slopes = self.judged(poses, every, reach)
        weighted = slopes * found[..., None]
        normal = weighted.transpose(0, 2, 1) @ slopes
        right = (weighted.transpose(0, 2, 1) @ gap[..., None])[..., 0]
        # Pull weakly towards the old pose, because a circle, for one, does not fix the rotation.
        size = float(np.mean(self.model.vectors**2)) + 1.0
        pull = 1e-3 * found.sum(axis=1) + 1e-6
        normal += pull[:, None, None] * np.diag([size, size, 1.0, 1.0])
        step = np.linalg.solve(normal, right[..., None])[..., 0]
        a = poses[:, 3] * np.cos(poses[:, 2]) + step[:, 0]
        b = poses[:, 3] * np.sin(poses[:, 2]) + step[:, 1]
        moved = poses[:, :2] + step[:, 2:]
        return np.column_stack((moved, np.arctan2(b, a), np.hypot(a, b)))

    def support(self, poses: np.ndarray, every: int = 1) -> np.ndarray:
        """Return the share of the entries that have an edge at their place, (P,)."""
        return self.judged(poses, every, REACH)[0].mean(axis=1)

    def best(
        self, poses: np.ndarray, least: float, most: int, apart_by: tuple[float, float, float]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fit poses; return the best ones that are apart, their support, and their indices.

        Their support is at least `least`, their number at most `most`.
        """
        every = max(1, len(self.model.vectors) // SAMPLE)
        for reach in (SEARCH, SEARCH // 2, REACH):
            poses = self.fitted(poses, every, reach)
        support = self.support(poses, every)
        order = np.argsort(-support, kind="stable")
        order = order[support[order] >= least / 2]  # half, because the fit has not converged yet
        # Merge poses that converged to the same place. All entries then decide among the others.
        order = order[apart(poses[order], 2 * most + 10, *SAME)]
        poses = poses[order]
        for _ in range(ROUNDS):
            poses = self.fitted(poses, 1, REACH)
        support = self.support(poses)
        again = np.argsort(-support, kind="stable")
        again = again[support[again] >= least]
        again = again[apart(poses[again], most, *apart_by)]
        return poses[again], support[again], order[again]
