"""The splats that a training begins with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cvkern._files import as_path
from cvkern.clouds.ply import properties, read_ply, read_vertices
from cvkern.kernels.codes.splats import Splats
from cvkern.radiance.fields.field import Frame
from cvkern.radiance.fields.voxel import VoxelField
from cvkern.radiance.scenes.photographs import Scene

RANDOM = "random"
CELLS, SHARES, STEPS = (32, 64), (0.3,), 200  # the field that shows where splats begin
VIEWS, PIXELS = 24, 4  # its views, about, and their pixels together for each splat
OPACITY = 0.1  # opacity of each splat
FARTHEST = 20.0  # half sides of the cube, of splats in a scene without bounds
INSIDE = 0.7  # their share that is in the cube
CONSTANT = 0.28209479177387814  # the first harmonic
NEIGHBOURS = 3
TINTS = "f_dc_0", "f_dc_1", "f_dc_2"  # properties of the constant colour of a splat in a file

Cloud = tuple[np.ndarray, np.ndarray | None]  # points (N, 3), and their colours in [0, 1], if any


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


def at_points_of(cloud: Cloud, frame: Frame, count: int, degree: int, seed: int) -> Splats:
    """Return splats at points of the world, each used as often as others, (N, ...) float32.

    Points that are used again are moved by about as much as points are apart.
    """
    points = (cloud[0].astype(np.float64) - np.array(frame.bounds.center)) / frame.bounds.half
    tints = np.full((len(points), 3), 0.5) if cloud[1] is None else cloud[1]
    rng = np.random.default_rng(seed)
    chosen = np.resize(rng.permutation(len(points)), count)
    places = points[chosen]
    if count > len(points):
        apart = spacing(points)[chosen, None]
        moves = apart * rng.normal(0, 0.5, (count, 3))
        places[len(points) :] += moves[len(points) :]
    return at_points(places, tints[chosen], degree)


def of_training(scene: Scene, options: Mapping[str, Any], count: int, seed: int) -> Cloud:
    """Return points that a small field of voxels shows after a short training; maybe none.

    Raises
    ------
    KeyboardInterrupt
        If that training is interrupted.
    """
    from cvkern.radiance.surfaces import point_cloud
    from cvkern.radiance.training import fit

    used = np.flatnonzero(~scene.test)
    own = replace(
        scene, images=scene.images[used], cameras=scene.cameras.select(used),
        test=np.zeros(len(used), bool), depths=None,
        masks=None if scene.masks is None else scene.masks[used],
    )  # fmt: skip
    if options["gauge"] is not None:
        options = {**options, "gauge": int(np.searchsorted(used, options["gauge"]))}
    model = fit(
        own, VoxelField(resolutions=CELLS, shares=SHARES), steps=STEPS, seed=seed,
        deterministic=True, progress=False, **options,
    )  # fmt: skip
    if model.training.stopped:
        raise KeyboardInterrupt
    views = range(0, len(model.cameras), max(1, len(model.cameras) // VIEWS))
    pixels = len(views) * model.cameras.width * model.cameras.height
    seen = model.cameras.scaled(min(1.0, math.sqrt(PIXELS * count / pixels)))
    cloud = point_cloud(model, seen, views=views)
    return cloud.points, cloud.colors / 255


def of_file(path: str) -> Cloud:
    """Return the points of a file; see :attr:`SplatField.start`.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it has no points, or one that is not finite.
    """
    cloud = _points_of(as_path(path))
    if not len(cloud[0]) or not np.isfinite(cloud[0]).all():
        raise ValueError(f"start must have points, all finite, got {path!r}")
    return cloud


def _points_of(file: Path) -> Cloud:
    if file.is_dir():
        from cvkern.reconstruction import read_reconstruction

        made = read_reconstruction(file)
        return made.points, made.colors / 255
    if file.suffix.lower() == ".npz":
        from cvkern.radiance.models import load_model
        from cvkern.radiance.surfaces import point_cloud

        cloud = point_cloud(load_model(file))
        return cloud.points, cloud.colors / 255
    points, colors = read_ply(file)
    if colors is not None or not {*TINTS, "opacity"} <= set(properties(file)):
        return points, None if colors is None else colors / 255
    table = read_vertices(file)
    solid = table["opacity"] > np.log(OPACITY / (1 - OPACITY))
    solid |= not solid.any()
    tints = 0.5 + CONSTANT * np.stack([table[name] for name in TINTS], axis=1)
    return points[solid], tints[solid]


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
