"""Camera paths that other programs write: nerfstudio's viewer, and instant-ngp's scripts."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_instance, check_integer, check_positive
from cvkern._files import as_path
from cvkern.radiance.pinhole import MOST_SIDE, Cameras
from cvkern.radiance.scenes import _blender

__all__ = ["CameraPath", "load_camera_path"]

MOST_FRAMES = 2**16
FIELD_OF_VIEW = 50.0  # degrees, of nerfstudio's viewer
FPS = 20.0


class CameraPath(NamedTuple):
    """The cameras of a film."""

    cameras: Cameras
    fps: float
    """Frames per second; 20 if the file does not say."""


def load_camera_path(
    path: str | os.PathLike[str], views: Cameras | None = None, *, factor: float = 1.0
) -> CameraPath:
    """Read a camera path.

    Parameters
    ----------
    path : path
        A ``camera_path.json`` of nerfstudio's viewer, or frames with a `transform_matrix` each, as
        in the ``transforms.json`` of instant-ngp and Blender. Axes of cameras are x right, y up,
        z backwards there; the world is that of the photographs. A nerfstudio scene that was
        turned, moved or scaled when it was read has another world.
    views : Cameras, optional
        Cameras of the photographs: their size, where the file does not name one, and the lens of
        the first, where it names none.
    factor : float, default 1.0
        Size of the pictures, relative to what the file says, > 0.

    Returns
    -------
    CameraPath
        Named tuple of `cameras`, one for each frame of a film, and `fps`. ``render_path`` takes
        both.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    TypeError
        If `factor` is not a number.
    ValueError
        If the file is not a camera path, a camera is missing or none, another kind than perspective
        ones is asked for, or neither the file nor `views` name the size of the pictures.

    Examples
    --------
    >>> import json, tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from cvkern.radiance import load_camera_path
    >>> frame = {"camera_to_world": np.eye(4).ravel().tolist(), "fov": 90, "aspect": 1}
    >>> film = {"render_height": 48, "render_width": 64, "fps": 24, "camera_path": [frame, frame]}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "camera_path.json")
    ...     _ = file.write_text(json.dumps(film))
    ...     found = load_camera_path(file)
    >>> len(found.cameras), found.fps, found.cameras.intrinsics[0].tolist()
    (2, 24.0, [24.0, 24.0, 31.5, 23.5])
    """
    file = as_path(path)
    if views is not None:
        check_instance(views, Cameras, "views")
    check_positive(factor, "factor")
    if not file.is_file():
        raise FileNotFoundError(f"path must be a file that exists, got {os.fspath(path)!r}")
    try:
        content = json.loads(file.read_text(encoding="utf-8-sig"))
    except (RecursionError, ValueError) as error:
        raise ValueError(f"{file} must be JSON: {error}") from None
    own = isinstance(content, dict) and "camera_path" in content
    frames = content.get("camera_path" if own else "frames") if isinstance(content, dict) else None
    if (
        not isinstance(frames, list)
        or not 1 <= len(frames) <= MOST_FRAMES
        or not all(isinstance(frame, dict) for frame in frames)
    ):
        raise ValueError(f"{file} must have camera_path or frames, a list of objects, got none")
    rate = _blender.number_of(file, content, "fps", FPS, 0.0)
    names = ("render_width", "render_height") if own else ("w", "h")
    wide, high = (
        _side(file, content, name, known)
        for name, known in zip(
            names, (None, None) if views is None else (views.width, views.height), strict=True
        )
    )
    read = _nerfstudio if own else _transforms
    poses, lenses, bent = read(file, content, frames, views, (wide, high))
    found = _blender.cameras_of(file, poses, np.array(lenses), wide, high, np.array(bent))
    return CameraPath(found if factor == 1 else found.scaled(factor), rate)


def _side(file: Path, content: dict[str, Any], name: str, known: int | None) -> int:
    """Return a side of the pictures."""
    found = _blender.number_of(file, content, name, math.nan if known is None else known, 0.0)
    if found != found:
        raise ValueError(f"{file} must give {name}, or views must be given, got neither")
    return check_integer(round(found), name, 1, MOST_SIDE)


def _nerfstudio(
    file: Path,
    content: dict[str, Any],
    frames: list[dict[str, Any]],
    views: Cameras | None,
    size: tuple[int, int],
) -> tuple[list[np.ndarray], list[list[float]], list[list[float]]]:
    """Return poses, fx, fy, cx, cy, and distortion of each frame."""
    kind = content.get("camera_type", "perspective")
    if kind != "perspective":
        raise ValueError(f"{file} must have perspective cameras, got {kind!r:.80}")
    wide, high = size
    poses, lenses = [], []
    for number, frame in enumerate(frames):
        matrix = frame.get("camera_to_world")
        if isinstance(matrix, list) and len(matrix) == 16:
            matrix = [matrix[row : row + 4] for row in range(0, 16, 4)]
        poses.append(_blender.pose_of(file, {"transform_matrix": matrix}, number))
        # The angle spans the height.
        angle = _blender.number_of(file, frame, "fov", FIELD_OF_VIEW, 0.0)
        if angle >= 180:
            raise ValueError(f"{file} must give fov below 180 degrees, got {angle:g} in {number}")
        focal = 0.5 * high / math.tan(0.5 * math.radians(angle))
        lenses.append([focal, focal, 0.5 * wide - 0.5, 0.5 * high - 0.5])
    return poses, lenses, [[0.0] * 5] * len(frames)


def _transforms(
    file: Path,
    content: dict[str, Any],
    frames: list[dict[str, Any]],
    views: Cameras | None,
    size: tuple[int, int],
) -> tuple[list[np.ndarray], list[list[float]], list[list[float]]]:
    """Return poses, fx, fy, cx, cy, and distortion of each frame."""
    poses, lenses, bent = [], [], []
    for number, frame in enumerate(frames):
        poses.append(_blender.pose_of(file, frame, number))
        lens = content | frame
        if views is not None and not {"fl_x", "camera_angle_x"} & lens.keys():
            scale = np.array([size[0] / views.width, size[1] / views.height] * 2)
            lenses.append((views.intrinsics[0] + [0, 0, 0.5, 0.5]) * scale - [0, 0, 0.5, 0.5])
            bent.append(views.distortion[0])
            continue
        found, curved = _blender.lens_of(file, lens, *size)
        lenses.append(found)
        bent.append(curved)
    return poses, lenses, bent
