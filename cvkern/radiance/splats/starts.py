"""The splats that a training begins with."""

from __future__ import annotations

import numpy as np

from cvkern.clouds.ply import properties, read_ply, read_vertices
from cvkern.kernels.codes.splats import Splats
from cvkern.radiance.fields.field import Frame

OPACITY = 0.1  # opacity of each splat
FARTHEST = 20.0  # half sides of the cube, of splats in a scene without bounds
INSIDE = 0.7  # their share that is in the cube
CONSTANT = 0.28209479177387814  # the first harmonic
NEIGHBOURS = 3
TINTS = "f_dc_0", "f_dc_1", "f_dc_2"  # properties of the constant colour of a splat in a file


def at_random(frame: Frame, count: int, degree: int, seed: int) -> Splats:
    """Return grey splats at random points of the frame, (N, ...) float32."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (count, 3))
    if frame.bounds.unbounded:
        outside = rng.random(count) > INSIDE
        away = rng.normal(size=(count, 3))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        reach = 1 / rng.uniform(1 / FARTHEST, 1, (count, 1))
        points = np.where(outside[:, None], away * reach, points)
    return at_points(points, np.full((count, 3), 0.5), degree)


def of_points(
    points: np.ndarray, colors: np.ndarray | None, count: int, degree: int, seed: int
) -> Splats:
    """Return splats at points of the frame, each used as often as others, (N, ...) float32.

    Points that are used again are moved by about as much as points are apart.
    """
    rng = np.random.default_rng(seed)
    chosen = np.resize(rng.permutation(len(points)), count)
    tints = np.full((len(points), 3), 0.5) if colors is None else colors
    places = points[chosen].astype(np.float64)
    again = np.arange(count) >= len(points)
    apart = spacing(points)[chosen][:, None]
    places[again] += (apart * rng.normal(0, 0.5, (count, 3)))[again]
    return at_points(places, tints[chosen], degree)


def of_file(path: str, frame: Frame, count: int, degree: int, seed: int) -> Splats:
    """Return splats at the points of a PLY file, (N, ...) float32; of splats, at those seen.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is no PLY file with finite points.
    """
    points, colors = read_ply(path)
    if not len(points) or not np.isfinite(points).all():
        raise ValueError(f"start must have points, all finite, got {path!r}")
    places = (points.astype(np.float64) - np.array(frame.bounds.center)) / frame.bounds.half
    if colors is None and {*TINTS, "opacity"} <= set(properties(path)):  # splats
        table = read_vertices(path)
        solid = table["opacity"] > np.log(OPACITY / (1 - OPACITY))
        solid |= not solid.any()
        tints = 0.5 + CONSTANT * np.stack([table[name] for name in TINTS], axis=1)
        places, tints = places[solid], tints[solid]
    else:
        tints = None if colors is None else colors / 255
    return of_points(places, tints, count, degree, seed)


def at_points(points: np.ndarray, colors: np.ndarray, degree: int) -> Splats:
    """Return round splats that just meet, (N, ...) float32; `colors` are in [0, 1]."""
    count = len(points)
    turns = np.zeros((count, 4))
    turns[:, 0] = 1
    sizes = np.log(spacing(points))[:, None].repeat(3, axis=1)
    logits = np.full((count, 1), np.log(OPACITY / (1 - OPACITY)))
    sides = np.zeros((count, 3 * ((degree + 1) ** 2 - 1)) if degree else (1, 1))
    found = points, turns, sizes, logits, (colors - 0.5) / CONSTANT, sides
    return Splats(*(a.astype(np.float32) for a in found))


def spacing(points: np.ndarray) -> np.ndarray:
    """Return the mean distance of each point from its nearest ones, at least 1e-4."""
    from scipy.spatial import KDTree

    count = min(NEIGHBOURS, len(points) - 1)
    if not count:
        return np.full(len(points), 0.1)
    distances, _ = KDTree(points).query(points, k=count + 1)
    return np.maximum(distances[:, 1:].mean(axis=1), 1e-4)
