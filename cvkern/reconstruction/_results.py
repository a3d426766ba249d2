"""What a reconstruction returns: in pixels of the photographs, and in a level world."""

from __future__ import annotations

import numpy as np

from cvkern.geometry.cameras.lens import Camera, matrix_of
from cvkern.panorama.registration import Heap
from cvkern.reconstruction._arguments import scaled
from cvkern.reconstruction._growth import Growth
from cvkern.reconstruction._photographs import Lenses
from cvkern.reconstruction.models import Reconstruction, levelled


def cameras_of(rows: np.ndarray, of: np.ndarray, heap: Heap) -> tuple[Camera, ...]:
    """Return the lenses in pixels of the photographs."""
    found = []
    for n, row in enumerate(rows):
        image = int(np.flatnonzero(of == n)[0])
        lens = scaled(row, 1 / heap.factors[image])
        found.append(Camera(matrix_of(*lens[:4]), lens[4:], tuple(heap.images[image].shape[:2])))
    return tuple(found)


def nothing(names: tuple[str, ...], lenses: Lenses, heap: Heap) -> Reconstruction:
    """Return a reconstruction without a placed photograph."""
    return Reconstruction(
        names, np.full((len(names), 3, 4), np.nan), cameras_of(lenses.rows, lenses.of, heap),
        lenses.of, np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros((0, 2), np.int32),
        np.zeros((0, 2)), np.zeros(0),
    )  # fmt: skip


def finished(names: tuple[str, ...], growth: Growth, heap: Heap) -> Reconstruction:
    """Return the finished model, in pixels of the photographs and in a level world."""
    tracks, placed = growth.tracks, growth.placed
    chosen = np.flatnonzero(growth.active)
    kept, point, counts = np.unique(tracks.track[chosen], return_inverse=True, return_counts=True)
    point, view = point.reshape(-1), tracks.view[chosen]
    turns = growth.rotations.transpose(0, 2, 1)
    eyes = -np.einsum("nij,nj->ni", turns, growth.translations)
    poses = np.full((len(names), 3, 4), np.nan)
    whole = np.concatenate((turns, eyes[:, :, None]), axis=2)
    poses[placed], points = levelled(whole[placed], growth.points[kept])
    large = (tracks.where[chosen] + 0.5) / heap.factors[view] - 0.5
    off = growth.distances(chosen) / np.sqrt(heap.factors[view].prod(axis=1))
    first = np.unique(point, return_index=True)[1]
    return Reconstruction(
        names, poses, cameras_of(growth.rows, growth.lenses.of, heap), growth.lenses.of, points,
        tracks.color[chosen][first], np.stack((point, view), axis=1).astype(np.int32),
        np.ascontiguousarray(large[:, ::-1]), np.bincount(point, off, len(kept)) / counts,
    )  # fmt: skip
