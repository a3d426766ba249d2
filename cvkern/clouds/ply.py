"""Point clouds as PLY files."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from cvkern._checks import check_dtype, check_image
from cvkern._files import as_path, replacing
from cvkern._runtime import runtime

PLACE = tuple((name, "<f4", "float") for name in ("x", "y", "z"))
TINT = tuple((name, "u1", "uchar") for name in ("red", "green", "blue"))


def write_ply(path: str | os.PathLike[str], points: Any, colors: Any = None) -> None:
    """Write a point cloud as binary PLY (little-endian), whole or not at all.

    Parameters
    ----------
    path : path
        An existing file is replaced once the new one is complete.
    points : array of shape (N, 3)
        Points (x, y, z), of any library; written as float32.
    colors : array of shape (N, 3), uint8, optional
        Red, green, blue.

    Raises
    ------
    FileNotFoundError
        If the folder of `path` does not exist.
    TypeError
        If `points` does not hold real numbers, or `colors` is not uint8.
    ValueError
        If a shape is wrong, a point is not finite in float32, or `path` does not end in ``.ply``.

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
    if as_path(path).suffix.lower() != ".ply":
        raise ValueError(f"path must end in .ply, got {os.fspath(path)!r}")
    places, tints = check_cloud(points, colors)
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


def check_cloud(points: Any, colors: Any) -> tuple[np.ndarray, Any]:
    """Return checked points and colours on the host, float32 and uint8; colours may be None."""
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
