"""Point clouds as PLY files."""

from __future__ import annotations

import itertools
import os
from typing import Any

import numpy as np

from cvkern._checks import check_dtype, check_image
from cvkern._files import as_path, replacing
from cvkern._runtime import runtime

HEAD = 256  # most lines of a head
PLACE = tuple((name, "<f4", "float") for name in ("x", "y", "z"))
TINT = tuple((name, "u1", "uchar") for name in ("red", "green", "blue"))

KINDS = {
    name: kind
    for kind, *names in (
        ("i1", "char", "int8"), ("u1", "uchar", "uint8"), ("i2", "short", "int16"),
        ("u2", "ushort", "uint16"), ("i4", "int", "int32"), ("u4", "uint", "uint32"),
        ("f4", "float", "float32"), ("f8", "double", "float64"),
    )
    for name in names
}  # fmt: skip


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


def read_ply(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray | None]:
    """Read the points of a PLY file.

    Parameters
    ----------
    path : path
        ASCII or binary PLY, of which `vertex` is the first element. Faces and properties other than
        places and colours are passed over.

    Returns
    -------
    points : array of shape (N, 3), float32
    colors : array of shape (N, 3), uint8, or None
        Red, green, blue, if the file has them as bytes.

    Raises
    ------
    FileNotFoundError
        If there is no file `path`.
    ValueError
        If `path` is not a PLY file with vertices, is damaged, or is cut short.

    Examples
    --------
    >>> import tempfile
    >>> from cvkern.clouds import read_ply, write_ply
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_ply(f"{folder}/one.ply", [[0, 0, 1]])
    ...     read_ply(f"{folder}/one.ply")
    (array([[0., 0., 1.]], dtype=float32), None)
    """
    table = read_vertices(path)
    row: Any = table.dtype
    points = np.stack([table[name] for name in ("x", "y", "z")], axis=1)
    names = [name for name, _, _ in TINT]
    tinted = all(name in row.fields and row[name].kind == "u" for name in names)
    colors = np.stack([table[name] for name in names], axis=1) if tinted else None
    return points.astype(np.float32), colors


def read_vertices(path: str | os.PathLike[str]) -> np.ndarray:
    """Return the vertices of a PLY file with all their properties; see :func:`read_ply`."""
    file = as_path(path)
    if not file.is_file():
        raise FileNotFoundError(f"path must be a file that exists, got {os.fspath(path)!r}")
    with file.open("rb") as stream:
        try:
            form, count, row = _head(stream)
            if form == "ascii":
                lines = [stream.readline().split() for _ in range(min(count, file.stat().st_size))]
                table: Any = np.array([tuple(line[: len(row)]) for line in lines], row)
            else:
                most = (file.stat().st_size - stream.tell()) // max(row.itemsize, 1)
                table = np.fromfile(stream, row, min(count, most))
            for name, _, _ in PLACE:
                table[name]
        except (ValueError, TypeError, LookupError, OverflowError) as error:
            raise ValueError(
                f"path must be a PLY file of points, got {file.name!r}: {error}"
            ) from None
    if len(table) != count:
        raise ValueError(f"path must have {count} points as it says, got {len(table)}")
    return table


def properties(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """Return the names of the properties of the vertices of a PLY file, without reading them."""
    with as_path(path).open("rb") as stream:
        try:
            return _head(stream)[2].names or ()
        except (ValueError, TypeError, LookupError, OverflowError):
            return ()  # reading it says why


def comments(path: str | os.PathLike[str]) -> list[str]:
    """Return the comments in the head of a PLY file."""
    found = []
    with as_path(path).open("rb") as stream:
        for line in itertools.islice(stream, HEAD):
            if line.startswith(b"end_header"):
                break
            if line.startswith(b"comment "):
                found.append(line[8:].decode(errors="replace").strip())
    return found


def _head(stream: Any) -> tuple[str, int, Any]:
    """Return the format, the number of points, and the dtype of a point."""
    words = [stream.readline(256).split() for _ in range(2)]
    if words[0] != [b"ply"] or len(words[1]) != 3:
        raise ValueError("it does not begin as one")
    form = words[1][1].decode()
    order = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    count, row, element = 0, [], b""
    for _ in range(HEAD):
        line = stream.readline(4096).split()
        if line[:1] == [b"end_header"]:
            return form, count, np.dtype(row)
        if line[:1] == [b"element"]:
            element = line[1]
            if not row and element != b"vertex":
                raise ValueError("its first element is no vertex")
            count = int(line[2]) if element == b"vertex" else count
        elif line[:1] == [b"property"] and element == b"vertex":
            row.append((line[2].decode(), order + KINDS[line[1].decode()]))
    raise ValueError("its header does not end")


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
