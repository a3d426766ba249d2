"""The surface of a panorama: its axes, its size, and the place of each image on it.

Every surface maps the pixel in column x and row y to the direction ``(a p, q, b p)``. Here a and b
depend on x only, p and q on y only. A plane has (a, b) = (x, 1) and (p, q) = (1, y), a cylinder
(sin x, cos x) and (1, y), a sphere (sin x, cos x) and (cos y, sin y). Kernels take them as tables.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cvkern.panorama.adjustment import straightened
from cvkern.panorama.models import Alignment

SURFACES = ("auto", "plane", "cylinder", "sphere")
PLANE_SPAN = math.radians(90)  # widest view, across its corners, that 'auto' draws on a plane
PLANE_MOST = math.radians(150)  # widest view that a plane can hold
CYLINDER_RISE = math.radians(50)  # highest view that 'auto' draws on a cylinder
CYLINDER_MOST = math.radians(75)
RIM = 0.25  # pixels that the last column may lie beyond the middles of all others
ALONG = 33  # points along each side of an image that determine its outline
FEW_SPREAD = 0.004  # directions determine a plane above this mean square of sines
CLEARLY = 9.0  # directions determine a plane above this ratio of squares
NEAR_UP = math.cos(math.radians(45))


class Canvas(NamedTuple):
    """A surface cut into pixels."""

    surface: str
    height: int
    width: int
    step: float
    """Radians, or pixels of the central image, of one pixel."""
    left: float
    """The coordinate of the middle of the first column."""
    top: float
    closed: bool
    """Whether the first column continues the last one."""
    matrices: np.ndarray
    """(N, 3, 3): from directions to pixels (x, y, 1) of each image."""
    rotations: np.ndarray | None
    """(N, 3, 3): from directions to the axes of each camera; None for images of a plane."""
    rects: np.ndarray
    """(N, 4): first column and row of each image, then one past its last ones. Columns of a closed
    canvas continue beyond its ends."""
    bend: float = 0.0
    """The lens moves a pixel at p from the middle of an image to ``p (1 + bend |p|^2)``."""

    def cameras(self) -> np.ndarray:
        """Return the matrices and the lens as kernels take them, (N, 10)."""
        return with_lens(self.matrices, self.bend)

    def columns(self, first: int, count: int) -> np.ndarray:
        """Return the table of columns, (count, 2) float64."""
        x = self.left + (first + np.arange(count)) * self.step
        if self.surface == "plane":
            return np.stack((x, np.ones_like(x)), axis=1)
        return np.stack((np.sin(x), np.cos(x)), axis=1)

    def rows(self, first: int, count: int) -> np.ndarray:
        """Return the table of rows, (count, 2) float64."""
        y = self.top + (first + np.arange(count)) * self.step
        if self.surface == "sphere":
            return np.stack((np.cos(y), np.sin(y)), axis=1)
        return np.stack((np.ones_like(y), y), axis=1)

    def coarser(self, factor: float) -> Canvas:
        """Return the same surface with pixels about `factor` times as large."""
        width = max(
            1, round(self.width / factor) if self.closed else math.ceil(self.width / factor)
        )
        factor = self.width / width if self.closed else factor
        height = max(1, math.ceil(self.height / factor))
        shift = (factor - 1) / 2 * self.step
        low = np.floor(self.rects[:, :2] / factor).astype(int)
        high = np.ceil(self.rects[:, 2:] / factor).astype(int)
        if self.closed:
            high[:, 0] = np.minimum(high[:, 0], low[:, 0] + width)
        else:
            high[:, 0] = np.minimum(high[:, 0], width)
        high[:, 1] = np.minimum(high[:, 1], height)
        return self._replace(
            height=height, width=width, step=self.step * factor, left=self.left + shift,
            top=self.top + shift, rects=np.concatenate((low, high), axis=1),
        )  # fmt: skip


def with_lens(matrices: np.ndarray, bend: float) -> np.ndarray:
    """Return matrices (..., 3, 3) and the number of the lens in one row each, (..., 10)."""
    rows = matrices.reshape(*matrices.shape[:-2], 9)
    return np.concatenate((rows, np.full((*rows.shape[:-1], 1), bend)), axis=-1)


def straighten(rotations: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """Return rotations (N, 3, 3) from level axes: x along the horizon, y down, z to the middle.

    People hold cameras so that their x axes are level. The vertical is therefore the direction with
    the least sum of squared projections on these axes [Brown and Lowe, section 5]. Cameras that all
    look nearly the same way, or above each other, do not determine it; the mean vertical of the
    cameras is used then. A camera turned by about a right angle counts as an upright one.
    """
    quarters = _quarter_turns(rotations, parents)
    most = np.bincount(quarters, minlength=4).argmax()
    angle = (quarters - most) * (math.pi / 2)
    right = np.stack((np.cos(angle), np.sin(angle), np.zeros_like(angle)), axis=1)
    down = np.stack((-np.sin(angle), np.cos(angle), np.zeros_like(angle)), axis=1)
    right, down = (np.einsum("nij,ni->nj", rotations, v.round()) for v in (right, down))
    values, vectors = np.linalg.eigh(right.T @ right / len(right))
    vertical = vectors[:, 0] if vectors[:, 0] @ down.sum(axis=0) >= 0 else -vectors[:, 0]
    clear = values[1] > max(FEW_SPREAD, CLEARLY * values[0])
    if not clear or (down @ vertical).mean() < NEAR_UP:
        across = _unit(right.mean(axis=0), right[0])
        mean = down.mean(axis=0)
        vertical = _unit(mean - across * (mean @ across), np.cross(rotations[0, 2], across))
    ahead = rotations[:, 2].sum(axis=0)
    # Cameras that look in all directions have no middle.
    ahead = _unit(ahead - vertical * (ahead @ vertical), np.cross(right[0], vertical))
    axes = np.stack((np.cross(vertical, ahead), vertical, ahead))  # from the world to level axes
    return rotations @ axes.T


def _unit(vector: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return a vector scaled to length 1, or `other` if it is too short to have a direction."""
    length = np.linalg.norm(vector)
    return vector / length if length > 1e-3 else other / np.linalg.norm(other)


def _quarter_turns(rotations: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """Return the number of right angles between each camera and the central one."""
    quarters = np.zeros(len(rotations), int)
    done = parents < 0
    # The parents are a tree, so each round reaches at least one camera more.
    while not done.all():
        for i in np.flatnonzero(~done & done[parents]):
            across = rotations[i] @ rotations[parents[i]].T
            roll = math.atan2(across[1, 0] - across[0, 1], across[0, 0] + across[1, 1])
            quarters[i] = (quarters[parents[i]] + round(roll / (math.pi / 2))) % 4
            done[i] = True
    return quarters


def lay_out(alignment: Alignment, sides: np.ndarray, surface: str, scale: float) -> Canvas:
    """Choose the surface and its size; `sides` (N, 2) are widths and heights."""
    middles = np.stack([np.array([[1, 0, x], [0, 1, y], [0, 0, 1]]) for x, y in (sides - 1) / 2])
    focals = alignment.focals
    if alignment.rotations is None or focals is None:
        return _plane(middles @ alignment.matrices, None, sides, 1.0 / scale, 0.0)
    step = 1.0 / (float(np.median(focals)) * scale)
    turned = straighten(alignment.rotations, alignment.parents)
    k = np.stack([np.diag([f, f, 1.0]) for f in focals])
    bend = alignment.bend
    views = [Outline(middles[i] @ k[i], turned[i], sides[i], bend) for i in range(len(focals))]
    if surface in ("auto", "plane"):
        widest = max(view.farthest() for view in views)
        if widest <= (PLANE_SPAN if surface == "auto" else PLANE_MOST) / 2:
            return _plane(middles @ k @ turned, turned, sides, step, bend)
    if surface in ("auto", "plane"):
        rise = max(abs(y) for view in views for y in view.rise())
        surface = "cylinder" if rise <= CYLINDER_RISE else "sphere"
    return _round(views, surface, step)._replace(bend=bend)


class Outline:
    """The directions of the rim of an image of a rotating camera."""

    def __init__(self, camera: np.ndarray, rotation: np.ndarray, side: np.ndarray, bend: float):
        self.matrix, self.rotation = camera @ rotation, rotation
        points = rim_of(side, bend)
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        rim = points @ np.linalg.inv(self.matrix).T
        self.rim = rim / np.linalg.norm(rim, axis=1, keepdims=True)
        self.poles = []
        for pole in (-1.0, 1.0):
            x, y, z = self.matrix[:, 1] * pole
            if z > 0 and low[0] <= x / z <= high[0] and low[1] <= y / z <= high[1]:
                self.poles.append(pole)
        self.centre = math.atan2(rotation[2, 0], rotation[2, 2])

    def farthest(self) -> float:
        """Return the largest angle from the z axis."""
        return float(np.arccos(self.rim[:, 2].clip(-1, 1)).max())

    def rise(self) -> tuple[float, float]:
        """Return the least and the largest angle below the horizon."""
        angles = np.arcsin(self.rim[:, 1].clip(-1, 1))
        low = -math.pi / 2 if -1.0 in self.poles else float(angles.min())
        return low, math.pi / 2 if 1.0 in self.poles else float(angles.max())

    def span(self) -> tuple[float, float]:
        """Return the least and the largest angle round the vertical, which may exceed pi."""
        if self.poles:
            return self.centre - math.pi, self.centre + math.pi
        x = np.arctan2(self.rim[:, 0], self.rim[:, 2]) - self.centre
        x = (x + math.pi) % (2 * math.pi) - math.pi
        return float(x.min()) + self.centre, float(x.max()) + self.centre


def rim_of(side: np.ndarray, bend: float) -> np.ndarray:
    """Return points (x, y, 1) that the lens moves to the rim of an image."""
    t = np.linspace(0, 1, ALONG)
    zero, one = np.zeros_like(t), np.ones_like(t)
    x, y = np.concatenate((t, t, zero, one)), np.concatenate((zero, one, t, t))
    rim = np.stack((x * (side[0] - 1), y * (side[1] - 1)), axis=1)
    middle = (np.asarray(side) - 1) / 2
    return np.column_stack((straightened(rim - middle, bend) + middle, np.ones_like(x)))


def _plane(
    matrices: np.ndarray,
    rotations: np.ndarray | None,
    sides: np.ndarray,
    step: float,
    bend: float,
) -> Canvas:
    boxes = []
    for matrix, side in zip(matrices, sides, strict=True):
        q = rim_of(side, bend) @ np.linalg.inv(matrix).T
        places = q[:, :2] / q[:, 2:] / step
        boxes.append(np.concatenate((places.min(axis=0), places.max(axis=0))))
    boxes = np.array(boxes)
    left, top = boxes[:, :2].min(axis=0)
    width, height = np.floor(boxes[:, 2:].max(axis=0) - (left, top) + RIM) + 1
    rects = _rects(boxes - (left, top, left, top), height)
    rects[:, 0] = rects[:, 0].clip(0, None)
    rects[:, 2] = rects[:, 2].clip(None, int(width))
    return Canvas("plane", int(height), int(width), step, left * step, top * step, False, matrices,
                  rotations, rects, bend)  # fmt: skip


def _rects(boxes: np.ndarray, height: float) -> np.ndarray:
    low, high = np.floor(boxes[:, :2]).astype(int), np.ceil(boxes[:, 2:]).astype(int) + 1
    low[:, 1] = low[:, 1].clip(0, None)
    high[:, 1] = high[:, 1].clip(None, int(height))
    return np.concatenate((low, high), axis=1)


def _round(views: list[Outline], surface: str, step: float) -> Canvas:
    """Lay views out on a cylinder or a sphere, and cut it in the middle of the widest gap."""
    spans = np.array([view.span() for view in views])
    rises = np.array([view.rise() for view in views])
    turn = 2 * math.pi
    begins = np.mod(spans[:, 0], turn)
    ends = begins + (spans[:, 1] - spans[:, 0])
    order = np.argsort(begins, kind="stable")
    gaps = []
    covered = float((ends - turn).max())  # views that continue beyond the end of the circle
    for i in order:
        gaps.append((begins[i] - covered, covered, begins[i]))
        covered = max(covered, ends[i])
    widest, gap_from, gap_to = max(gaps)
    closed = bool(widest <= 2 * step)
    middle = views[0].centre if closed else (gap_from + gap_to) / 2 + math.pi
    width = round(turn / step)
    if closed:
        step = turn / width
    level = np.array([[math.cos(middle), 0, math.sin(middle)], [0, 1, 0],
                      [-math.sin(middle), 0, math.cos(middle)]])  # fmt: skip
    matrices = np.stack([view.matrix @ level for view in views])
    centres = np.array([view.centre for view in views]) - middle
    shift = np.round(centres / turn) * turn + middle
    spans = (spans - shift[:, None]) / step
    if surface == "cylinder":
        rises = np.tan(rises.clip(-CYLINDER_MOST, CYLINDER_MOST))
    rises = rises / step
    top = float(rises[:, 0].min())
    height = math.floor(rises[:, 1].max() - top + RIM) + 1
    if closed:
        left = -(width // 2)
    else:
        left = float(spans[:, 0].min())
        width = math.floor(spans[:, 1].max() - left + RIM) + 1
    boxes = np.stack(
        (spans[:, 0] - left, rises[:, 0] - top, spans[:, 1] - left, rises[:, 1] - top), 1
    )
    rects = _rects(boxes, height)
    if closed:
        rects[:, 2] = np.minimum(rects[:, 2], rects[:, 0] + width)
    else:
        rects[:, (0, 2)] = rects[:, (0, 2)].clip(0, width)
    return Canvas(surface, height, width, step, left * step, top * step, closed, matrices,
                  np.stack([view.rotation @ level for view in views]), rects)  # fmt: skip
