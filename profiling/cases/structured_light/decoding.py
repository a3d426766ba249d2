"""From photographs of patterns to the projector's coordinates."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Shape, Work, relative, unequal

FREQUENCIES, STEPS = (1, 8, 64), 4
NOISE = 2.0  # standard deviation of a photograph's, in its values
# A phase is off by 2e-7 in the arc tangent and some roundings of 2^-24; of 64 fringes it is a share
# of the whole axis.
PLACE = 1e-6


def _gray(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Photograph the patterns of a projector that is as large as the image, columns alone."""
    seen = cvkern.gray_code_patterns(shape, axes=["columns"]) * np.float32(0.7)
    return (20 + seen + rng.normal(0, NOISE, seen.shape)).clip(0, 255).astype(np.uint8)


def _columns(frames: np.ndarray) -> np.ndarray:
    bits = np.cumsum(frames[0::2] > frames[1::2], axis=0) % 2
    return np.tensordot(2 ** np.arange(len(bits) - 1, -1, -1), bits, 1).astype(np.int32)


def _decode(frames: Any) -> Any:
    shape = tuple(frames.shape[1:])
    return cvkern.decode_gray_code(frames, shape, axes=["columns"], margin=5).columns


def _fringes(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    seen = cvkern.phase_shift_patterns(shape, FREQUENCIES, STEPS, axes=["columns"])
    noisy = 20 + seen * np.float32(0.7) + rng.normal(0, NOISE, seen.shape)
    return noisy.clip(0, 255).astype(np.uint8)


def _places(frames: np.ndarray) -> np.ndarray:
    place = np.zeros(frames.shape[1:])
    for j, f in enumerate(FREQUENCIES):
        turns = 2 * math.pi * np.arange(STEPS) / STEPS
        own = frames[j * STEPS : (j + 1) * STEPS].astype(np.float64)
        s, c = np.tensordot(np.sin(turns), own, 1), np.tensordot(np.cos(turns), own, 1)
        p = np.arctan2(s, c) / (2 * math.pi)
        k = np.where(p < 0, 1, 0) if j == 0 else np.floor(f * place - p + 0.5)
        place = (p + k) / f
    return (place - np.floor(place)) * frames.shape[2] - 0.5


def _decode_phase(frames: Any) -> Any:
    return cvkern.decode_phase_shift(
        frames, tuple(frames.shape[1:]), FREQUENCIES, STEPS, axes=["columns"], threshold=10
    ).columns


def _scanner(shape: Shape) -> cvkern.StereoCalibration:
    """Return a camera of a shape, and a projector as large to its left."""
    height, width = shape
    matrix = np.diag([1.2 * width, 1.2 * width, 1])
    matrix[:2, 2] = (width - 1) / 2, (height - 1) / 2
    camera = cvkern.Camera(matrix, (-0.1, 0.02), shape)
    turns, shifts = np.zeros((0, 3, 3)), np.zeros((0, 3))
    shift = np.array([1.5, 0, 0])
    return cvkern.StereoCalibration(
        camera, camera, np.eye(3), shift, 0.0, turns, shifts, np.zeros(24)
    )


def _hill(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Return the columns of that projector that light a hill."""
    scanner = _scanner(shape)
    points = _points(shape).reshape(-1, 3)
    lit = cvkern.project_points(points, scanner.right, scanner.rotation, scanner.translation)
    return lit[:, 1].reshape(shape).astype(np.float32)


def _points(shape: Shape) -> np.ndarray:
    """Return the points of the hill that pixels see."""
    y, x = np.indices(shape, np.float64)
    places = np.stack((y.ravel(), x.ravel()), axis=1)
    rays = cvkern.undistort_points(places, _scanner(shape).left, np.eye(3))[:, ::-1]
    depth = 8 + np.sin(4 * rays[:, 0]) * np.cos(3 * rays[:, 1])
    return (depth[:, None] * np.column_stack((rays, np.ones(len(rays))))).reshape(*shape, 3)


def _cloud(columns: Any) -> Any:
    return cvkern.triangulate_columns(columns, _scanner(tuple(columns.shape)))


def _lit_hill(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Photograph the hill under fringes of that projector."""
    place = (_hill(shape, rng).astype(np.float64) + 0.5) / shape[1]
    seen = []
    for f in FREQUENCIES:
        for n in range(STEPS):
            seen.append(110 + 85 * np.cos(2 * math.pi * (f * place - n / STEPS)))
    noisy = np.stack(seen) + rng.normal(0, NOISE, (len(seen), *shape))
    return noisy.round().clip(0, 255).astype(np.uint8)


def _phase_cloud(frames: Any) -> Any:
    shape = tuple(frames.shape[1:])
    found = cvkern.decode_phase_shift(
        frames, shape, FREQUENCIES, STEPS, axes=["columns"], threshold=10
    )
    return cvkern.triangulate_columns(found.columns, _scanner(shape), found.valid)


def _distances(ours: tuple[np.ndarray, ...], right: tuple[np.ndarray, ...]) -> np.ndarray:
    """The relative distances of points that the projector lights; one of inf if they are few."""
    known = np.isfinite(ours[0]).all(axis=2)
    gaps = np.linalg.norm(ours[0] - right[0], axis=2)[known] / right[0][known][:, 2]
    return gaps if known.mean() > 0.5 else np.array([np.inf])


CASES = (
    Case(
        name="triangulate_columns",
        title="Points in space of a projector's columns",
        image=_hill,
        call=_cloud,
        oracle=lambda columns: _points(columns.shape),
        oracle_name="the hill that the columns are of",
        difference=lambda ours, right: float(_distances(ours, right).max()),
        tolerance=1e-3,  # columns of 2000 are rounded by 6e-5, of which 300 are the hill's depth
        bytes_per_pixel=4 + 12,
        operations_per_pixel=400,
        work=Work("points", lambda columns: columns.size),
        sizes=("1080p",),
        margin=0,
    ),
    Case(
        name="phase_cloud",
        title="Points in space of three fringes in four steps, uint8",
        image=_lit_hill,
        call=_phase_cloud,
        oracle=lambda frames: _points(frames.shape[1:]),
        oracle_name="the hill that was photographed",
        difference=lambda ours, right: float(np.median(_distances(ours, right))),
        # Noise of 2 in 85 moves a place by sqrt(2 / 4) 2 / 85 / 2 pi / 64 of the width; the hill's
        # depth is 3 to 10 times the columns', so a median of 3e-4, more in small pictures.
        tolerance=2e-3,
        bytes_per_pixel=12 + 12,
        operations_per_pixel=12 * 4 + 3 * 40 + 400,
        work=Work("points", lambda frames: frames.shape[1] * frames.shape[2]),
        sizes=("1080p",),
        margin=0,
    ),
    Case(
        name="decode_gray_code",
        title="Gray code of the columns, uint8",
        image=_gray,
        call=_decode,
        oracle=_columns,
        oracle_name="NumPy",
        difference=unequal,
        tolerance=0.0,
        bytes_per_pixel=2 * 11 + 5,
        operations_per_pixel=11 * 6,
        work=Work("pixels", lambda frames: frames.shape[1] * frames.shape[2]),
        sizes=("1080p",),
        margin=0,
    ),
    Case(
        name="decode_phase_shift",
        title="Columns of three fringes in four steps, uint8",
        image=_fringes,
        call=_decode_phase,
        oracle=_places,
        oracle_name="NumPy in float64",
        difference=relative,
        tolerance=PLACE,
        bytes_per_pixel=12 + 13,
        operations_per_pixel=12 * 4 + 3 * 40,
        work=Work("pixels", lambda frames: frames.shape[1] * frames.shape[2]),
        sizes=("1080p",),
        margin=0,
    ),
)
