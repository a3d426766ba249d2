"""Scenes of COLMAP: ``cameras``, ``images`` and ``points3D``, as text or binary."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cvkern.radiance.pinhole import cameras
from cvkern.radiance.scenes._masks import beside as masks_beside
from cvkern.radiance.scenes._masks import read_masks
from cvkern.radiance.scenes.photographs import (
    Bounds,
    Scene,
    every,
    focus_of,
    read_images,
    refuse_outside,
    shrunk,
    view_directions,
)

# Number and name of the lens models, and the roles of their parameters.
MODELS = {
    0: ("SIMPLE_PINHOLE", "fcc"),
    1: ("PINHOLE", "ffcc"),
    2: ("SIMPLE_RADIAL", "fcck"),
    3: ("RADIAL", "fcckk"),
    4: ("OPENCV", "ffcckkpp"),
}
LAYOUTS = dict(MODELS.values())
MOST_POINTS = 2**14  # most points used to find the range of depths

Lens = tuple[str, int, int, tuple[float, ...]]  # model, width, height, parameters
View = tuple[str, int, tuple[float, ...]]  # photograph, camera, quaternion and translation


def load(file: Path, test_every: int, outside: bool = False) -> Scene:
    """Read a scene; see :func:`cvkern.radiance.load_scene`."""
    binary = file.suffix == ".bin"
    beside = {name: file.with_name(f"{name}{file.suffix}") for name in ("images", "points3D")}
    if not beside["images"].exists():
        raise FileNotFoundError(f"scene must have {beside['images'].name} beside {file}")
    try:
        lenses = (_binary_cameras if binary else _text_cameras)(file)
        views = (_binary_images if binary else _text_images)(beside["images"])
        points = np.empty((0, 3))
        if beside["points3D"].exists():
            points = (_binary_points if binary else _text_points)(beside["points3D"])
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise ValueError(f"{file.parent} must be a whole COLMAP model: {error}") from None
    if not np.isfinite(points).all():
        raise ValueError(f"{beside['points3D']} must have finite points")
    views.sort()
    folder = _photographs(file)
    names = [name for name, _, _ in views]
    for number, name in enumerate(() if outside else names):
        refuse_outside(beside["images"], name, number)
    images = read_images([folder / name for name in names])
    height, width = images.shape[1:3]
    masks = read_masks(masks_beside(folder, names), height, width)
    intrinsics, distortion, poses = [], [], []
    for name, camera, place in views:
        if camera not in lenses:
            raise ValueError(f"{file} must have camera {camera}, which {name} was taken with")
        lens, bent = _lens(lenses[camera], width, height, file)
        intrinsics.append(lens)
        distortion.append(bent)
        if not np.isfinite(place).all() or not any(place[:4]):
            raise ValueError(f"{beside['images']} must have finite poses, got {place} for {name}")
        poses.append(_pose(place))
    try:
        seen = cameras(np.stack(poses), intrinsics, width, height, distortion=distortion)
    except ValueError as error:
        raise ValueError(f"{file.parent}: {error}") from None
    bounds, near, far = _extent(seen.poses, points)
    return Scene(images, seen, every(len(views), test_every), bounds, near, far, masks=masks)


def _lens(lens: Lens, width: int, height: int, file: Path) -> tuple[list[float], list[float]]:
    model, wide, high, values = lens
    if model not in LAYOUTS:
        raise ValueError(f"{file} must use one of {tuple(LAYOUTS)}, got {model}")
    layout = LAYOUTS[model]
    if len(values) != len(layout):
        raise ValueError(f"{file} must give {len(layout)} parameters for {model}, got {values}")
    group = {kind: [v for v, k in zip(values, layout, strict=True) if k == kind] for kind in "fckp"}
    across, down = shrunk(width, height, wide, high, file)
    fx, fy = group["f"][0] * across, group["f"][-1] * down
    # COLMAP measures from the corner of the first pixel.
    cx, cy = group["c"][0] * across - 0.5, group["c"][1] * down - 0.5
    k1, k2 = (*group["k"], 0.0, 0.0)[:2]
    p1, p2 = (*group["p"], 0.0, 0.0)[:2]
    return [fx, fy, cx, cy], [k1, k2, p1, p2, 0.0]


def _pose(place: tuple[float, ...]) -> np.ndarray:
    """Return the pose, camera to world, from quaternion and translation of its inverse."""
    turn = rotation_of(place[:4])
    return np.column_stack((turn.T, -turn.T @ np.array(place[4:])))


def rotation_of(quaternion: Any) -> np.ndarray:
    """Return the rotation of a quaternion (w, x, y, z) of any length."""
    w, x, y, z = np.array(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _extent(poses: np.ndarray, points: np.ndarray) -> tuple[Bounds, float, float]:
    """Return a cube around the cameras, and the range of depths of the points."""
    eyes, center = poses[:, :, 3], focus_of(poses)
    half = float(np.abs(eyes - center).max()) or 1.0
    near, far = 0.05 * half, np.inf
    if len(points):
        points = points[:: -(-len(points) // MOST_POINTS)]
        ahead = view_directions(poses)
        depths = points @ ahead.T - (eyes * ahead).sum(axis=1)
        depths = depths[depths > 0]
        if depths.size:
            near, far = (float(q) for q in np.quantile(depths, [0.001, 0.999]) * [0.8, 1.5])
    return Bounds((float(center[0]), float(center[1]), float(center[2])), half, True), near, far


def _photographs(file: Path) -> Path:
    for parent in file.parents[:3]:
        if (parent / "images").is_dir():
            return parent / "images"
    raise FileNotFoundError(f"scene must have a folder 'images' beside or above {file}")


def _lines(file: Path) -> Iterator[list[str]]:
    for line in file.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            yield line.split()


def _text_cameras(file: Path) -> dict[int, Lens]:
    found: dict[int, Lens] = {}
    for words in _lines(file):
        if words:
            values = tuple(_number(w, file) for w in words[4:])
            number, width, height = (_integer(words[i], file) for i in (0, 2, 3))
            found[number] = words[1], width, height, values
    return found


def _text_images(file: Path) -> list[View]:
    lines = list(_lines(file))
    # There are two lines per photograph; the second, with its points, may be empty.
    heads = [words for words in lines[::2] if words]
    return [
        (" ".join(w[9:]), _integer(w[8], file), tuple(_number(v, file) for v in w[1:8]))
        for w in heads
    ]


def _text_points(file: Path) -> np.ndarray:
    rows = [[_number(v, file) for v in words[1:4]] for words in _lines(file) if words]
    return np.array(rows, np.float64).reshape(-1, 3)


def _number(word: str, file: Path) -> float:
    try:
        return float(word)
    except ValueError:
        raise ValueError(f"{file} must have numbers, got {word!r}") from None


def _integer(word: str, file: Path) -> int:
    try:
        return int(word)
    except ValueError:
        raise ValueError(f"{file} must have integers, got {word!r}") from None


class _Bytes:
    """A little-endian binary file, read from front to back."""

    def __init__(self, file: Path):
        self.data, self.at = file.read_bytes(), 0

    def take(self, layout: str) -> tuple[Any, ...]:
        values = struct.unpack_from("<" + layout, self.data, self.at)
        self.at += struct.calcsize("<" + layout)
        return values

    def text(self) -> str:
        end = self.data.index(b"\0", self.at) if b"\0" in self.data[self.at :] else -1
        if end < 0:
            raise IndexError("a name has no end")
        found = self.data[self.at : end].decode()
        self.at = end + 1
        return found

    def skip(self, count: int) -> None:
        self.at += count
        if self.at > len(self.data):
            raise IndexError("the file ends too soon")


def _binary_cameras(file: Path) -> dict[int, Lens]:
    data, found = _Bytes(file), {}
    for _ in range(data.take("Q")[0]):
        number, model, width, height = data.take("iiQQ")
        if model not in MODELS:
            raise ValueError(f"{file} must use one of {tuple(LAYOUTS)}, got model {model}")
        name, layout = MODELS[model]
        found[number] = name, width, height, data.take(f"{len(layout)}d")
    return found


def _binary_images(file: Path) -> list[View]:
    data, found = _Bytes(file), []
    for _ in range(data.take("Q")[0]):
        _, *place, camera = data.take("i7di")
        name = data.text()
        data.skip(24 * data.take("Q")[0])  # skip the points in the photograph: x, y, number
        found.append((name, camera, tuple(place)))
    return found


def _binary_points(file: Path) -> np.ndarray:
    data = _Bytes(file)
    points = []
    for _ in range(data.take("Q")[0]):  # a damaged file may hold fewer
        _, *place, _, _, _, _ = data.take("Q3d3Bd")
        points.append(place)
        data.skip(8 * data.take("Q")[0])  # skip the photographs that see the point
    return np.array(points, np.float64).reshape(-1, 3)
