"""Point clouds: PLY files, and moving pictures of them."""

from __future__ import annotations

import importlib.util
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cvkern._files import check_target, replacing
from cvkern._overlay import check_color
from cvkern._runtime import runtime
from cvkern._validate import check_dtype, check_image, check_integer, check_number, check_positive

__all__ = ["turntable", "write_animation", "write_ply"]

PLACE = tuple((name, "<f4", "float") for name in ("x", "y", "z"))
TINT = tuple((name, "u1", "uchar") for name in ("red", "green", "blue"))
SAMPLES = 2  # of a pixel, down and across: what smooths the rims of points
INSIDE = (0.005, 0.995)  # quantiles of the directions that the picture has room for
MARGIN = 1.12
NARROWEST = 1e-3  # of a view, as a share of the distance
PIVOT = 0.3  # quantile of the depths that the camera swings about
NOD = 0.3  # how far it goes up and down, of how far it goes to the sides
COVER = 1.8  # edge of a point over the distance of its neighbours, as slanted surfaces need it


def write_ply(path: str | os.PathLike[str], points: Any, colors: Any = None) -> None:
    """Write a point cloud as binary PLY (little-endian), whole or not at all.

    Parameters
    ----------
    path : path
        An existing file is replaced once the new one is complete.
    points : array of shape (N, 3)
        (x, y, z), of any library; written as float32.
    colors : array of shape (N, 3), uint8, optional
        Red, green, blue.

    Raises
    ------
    FileNotFoundError
        If the folder of `path` does not exist.
    TypeError
        If `points` does not hold real numbers, or `colors` is not uint8.
    ValueError
        If a shape is another, a point is not finite in float32, or `path` does not end in ``.ply``.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from cvkern.clouds import write_ply
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_ply(f"{folder}/one.ply", [[0, 0, 1]], np.uint8([[255, 0, 0]]))
    ...     Path(folder, "one.ply").stat().st_size
    190
    """
    if Path(path).suffix.lower() != ".ply":
        raise ValueError(f"path must end in .ply, got {os.fspath(path)!r}")
    places, tints = _check_cloud(points, colors)
    fields = PLACE if tints is None else PLACE + TINT
    table = np.empty(len(places), [(name, kind) for name, kind, _ in fields])
    columns = [*places.T, *(() if tints is None else tints.T)]
    for (name, _, _), column in zip(fields, columns, strict=True):
        table[name] = column
    properties = "".join(f"property {said} {name}\n" for name, _, said in fields)
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(table)}\n{properties}end_header\n"
    )
    with replacing(path) as beside, beside.open("wb") as file:
        file.write(head.encode("ascii"))
        file.write(table.tobytes())


def turntable(
    points: Any,
    colors: Any,
    *,
    shape: tuple[int, int] = (360, 480),
    frames: int = 60,
    swing: float = 20.0,
    point_size: float | None = None,
    background: Sequence[float] = (16, 17, 20),
) -> np.ndarray:
    """Draw a cloud from a camera that swings about it, or goes all the way round.

    Parameters
    ----------
    points : array of shape (N, 3)
        As :func:`cvkern.point_cloud` gives them: x right, y down, z forward from the camera at the
        origin. Points behind it are not drawn.
    colors : array of shape (N, 3), uint8
        Red, green, blue.
    shape : (int, int), default (360, 480)
        Rows and columns of a frame.
    frames : int, default 60
        They make a loop; the first is the view of the camera at the origin.
    swing : float, default 20.0
        Degrees to either side, in (0, 180]; 180 goes round, at an even pace.
    point_size : float, optional
        Edge of the square of a point in the first frame, pixels, > 0. By default what closes the
        gaps between neighbours.
    background : (red, green, blue), default (16, 17, 20)
        In [0, 255].

    Returns
    -------
    array of shape (frames, rows, columns, 3), uint8

    Raises
    ------
    TypeError
        If `points` does not hold real numbers, or `colors` is not uint8.
    ValueError
        If a shape is another, a point is not finite, none lies in front of the camera, or a number
        is out of its range.

    Notes
    -----
    What is nearest is seen; of points at one depth, the first. The pictures are the same on every
    device and kernel set.

    Examples
    --------
    >>> import numpy as np
    >>> from cvkern.clouds import turntable
    >>> points = np.random.default_rng(0).normal((0, 0, 9), 1, (99, 3))
    >>> turntable(points, np.full((99, 3), 255, np.uint8), frames=4).shape
    (4, 360, 480, 3)
    """
    colors = check_image(colors, name="colors")  # not None
    places, tints = _check_cloud(points, colors)
    if np.shape(shape) != (2,):
        raise ValueError(f"shape must be rows and columns, got {shape}")
    height, width = (check_integer(n, "shape", 1, 2**13) for n in shape)
    count = check_integer(frames, "frames", 1, 2**12)
    swing = check_number(swing, "swing")
    if not 0 < swing <= 180:
        raise ValueError(f"swing must lie in (0, 180], got {swing:g}")
    if point_size is not None:
        point_size = check_positive(point_size, "point_size")
    behind = np.round(check_color(background, "background")).astype(np.uint8)
    seen = places[places[:, 2] > 0].astype(np.float64)
    if len(seen) == 0:
        raise ValueError(f"points must lie in front of the camera, got {len(places)} behind it")
    focal, cx, cy, pivot = _view(seen, height, width)
    if point_size is None:
        point_size = COVER * max(1.0, math.sqrt(height * width / len(seen)))
    # Samples are finer than pixels: theirs are the places in between.
    focal, (cx, cy) = SAMPLES * focal, (SAMPLES * c + 0.5 * (SAMPLES - 1) for c in (cx, cy))

    rt = runtime(points, colors)
    cloud, paint = rt.adopt(places), rt.adopt(tints, np.uint8)
    keys = rt.scratch("turntable.keys", (SAMPLES * height, SAMPLES * width), np.int64)
    image = rt.scratch("turntable.image", (height, width, 3), np.uint8)
    movie = np.empty((count, height, width, 3), np.uint8)
    for k in range(count):
        pose = rt.adopt(_pose(k / count, swing, pivot))
        rt.clouds.splat(cloud, pose, focal, cx, cy, SAMPLES * point_size, keys)
        rt.clouds.shade(keys, paint, rt.constant(behind), SAMPLES, image)
        movie[k] = rt.to_numpy(image)
    return movie


def write_animation(path: str | os.PathLike[str], frames: Any, *, fps: float = 20.0) -> None:
    """Write frames as a GIF that repeats for ever, or as an MP4; whole or not at all.

    Parameters
    ----------
    path : path
        Ends in ``.gif``, or in ``.mp4`` where imageio-ffmpeg is installed.
    frames : array of shape (F, H, W, 3), uint8
        A GIF has 256 colours in each frame; an MP4 needs an even height and width.
    fps : float, default 20.0
        Frames a second, > 0; a GIF counts in hundredths of a second, and has at most 50.

    Raises
    ------
    FileNotFoundError
        If the folder of `path` does not exist.
    ModuleNotFoundError
        If `path` ends in ``.mp4`` and imageio-ffmpeg is not installed.
    PermissionError
        If nothing can be written in that folder.
    ValueError
        If `path` ends otherwise or is a folder, or `frames` or `fps` is not as above.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from cvkern.clouds import write_animation
    >>> frames = np.zeros((2, 4, 6, 3), np.uint8)
    >>> frames[1] = 255
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_animation(f"{folder}/blink.gif", frames, fps=2)
    ...     Path(folder, "blink.gif").read_bytes()[:6]
    b'GIF89a'
    """
    movie = np.asarray(frames)
    if movie.ndim != 4 or movie.shape[3] != 3 or movie.size == 0 or movie.dtype != np.uint8:
        raise ValueError(
            f"frames must be uint8 of shape (F, H, W, 3), got {movie.dtype} of shape {movie.shape}"
        )
    fps = check_animation(path, movie.shape, fps)
    import imageio.v3 as iio

    with replacing(path) as beside:
        if Path(path).suffix.lower() == ".gif":
            options = {"plugin": "pillow", "duration": round(1e3 / fps), "loop": 0}
            # By way of memory: imageio tries a file that cannot be written again on its way out.
            beside.write_bytes(iio.imwrite("<bytes>", movie, extension=".gif", **options))
        else:
            iio.imwrite(beside, movie, plugin="FFMPEG", fps=fps, macro_block_size=2, quality=8)


def check_animation(path: str | os.PathLike[str], shape: tuple[int, ...], fps: Any) -> float:
    """Return `fps` if frames of a shape (F, H, W, 3) can be written to `path`: ask before the work.

    The errors are those of :func:`write_animation`.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".gif", ".mp4"):
        raise ValueError(f"path must end in .gif or .mp4, got {os.fspath(path)!r}")
    check_target(path)
    fps = check_positive(fps, "fps")
    if suffix == ".gif" and fps > 50:
        raise ValueError(f"fps must be <= 50 for .gif, got {fps:g}")
    if suffix == ".mp4":
        if shape[1] % 2 or shape[2] % 2:
            raise ValueError(
                f"frames must have an even height and width for .mp4, got shape {shape}"
            )
        if importlib.util.find_spec("imageio_ffmpeg") is None:
            raise ModuleNotFoundError("MP4 needs imageio-ffmpeg: pip install imageio-ffmpeg")
    return fps


def _check_cloud(points: Any, colors: Any) -> tuple[np.ndarray, Any]:
    """Return points and colours on the host, float32 and uint8, or None for no colours."""
    points = check_image(points, name="points")
    if points.shape[1] != 3:
        raise ValueError(f"points must have shape (N, 3), got {tuple(points.shape)}")
    rt = runtime(points, colors)
    with np.errstate(over="ignore"):
        places = rt.to_numpy(rt.adopt(points))
    if not np.isfinite(places).all():
        raise ValueError(f"points must be finite, got {places[~np.isfinite(places)][0]}")
    if colors is None:
        return places, None
    colors = check_image(colors, name="colors")
    if tuple(colors.shape) != tuple(points.shape):
        raise ValueError(
            f"colors must have shape {tuple(points.shape)}, as the points, "
            f"got {tuple(colors.shape)}"
        )
    check_dtype(colors, np.uint8, "colors")
    return places, rt.to_numpy(rt.adopt(colors, np.uint8))


def _view(points: np.ndarray, height: int, width: int) -> tuple[float, float, float, np.ndarray]:
    """Return a focal length and principal point that show the points, and what to swing about."""
    low, high = np.quantile(points[:, :2] / points[:, 2:], INSIDE, axis=0)
    spread = np.maximum(high - low, NARROWEST)
    focal = float(min(np.array([width, height]) / spread)) / MARGIN
    middle = 0.5 * (low + high)
    cx, cy = 0.5 * np.array([width - 1, height - 1]) - focal * middle
    pivot = np.quantile(points[:, 2], PIVOT) * np.array([*middle, 1.0])
    return focal, float(cx), float(cy), pivot


def _pose(turn: float, swing: float, pivot: np.ndarray) -> np.ndarray:
    """Return where the camera is at `turn`, in [0, 1), of the loop: a matrix (3, 4)."""
    angle = 2 * np.pi * turn
    side, nod = np.deg2rad(swing) * np.array([np.sin(angle), NOD * np.sin(2 * angle)])
    if swing == 180:
        side, nod = angle, 0.0
    about_y = [[np.cos(side), 0, np.sin(side)], [0, 1, 0], [-np.sin(side), 0, np.cos(side)]]
    about_x = [[1, 0, 0], [0, np.cos(nod), -np.sin(nod)], [0, np.sin(nod), np.cos(nod)]]
    turned = np.array(about_x) @ np.array(about_y)
    return np.column_stack((turned, pivot - turned @ pivot)).astype(np.float32)
