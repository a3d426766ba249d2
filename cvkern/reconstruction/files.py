"""Files of reconstructions: COLMAP's text and binary, ``transforms.json``, and PLY."""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np

from cvkern._checks import check_choice, check_instance
from cvkern._files import as_path, replacing, write_text
from cvkern.geometry.cameras.lens import Camera, focal_and_center, matrix_of
from cvkern.radiance.scenes import _colmap
from cvkern.reconstruction.models import Reconstruction, checked

FORMATS = ("colmap", "colmap_binary", "transforms", "ply")
COLMAP = ("cameras", "images", "points3D")
OPENCV = 4  # COLMAP's number of this lens model
TRANSFORMS, CLOUD = "transforms.json", "points.ply"


def write_reconstruction(
    path: str | os.PathLike[str],
    reconstruction: Reconstruction,
    *,
    format: str = "colmap",
    images: str = "images",
) -> list[Path]:
    """Write a reconstruction into a folder, for other programs.

    Parameters
    ----------
    path : str or path
        A folder that exists. Files of the same names are replaced.
    reconstruction : Reconstruction
        Cameras and points; photographs without a place are left out.
    format : {'colmap', 'colmap_binary', 'transforms', 'ply'}, default 'colmap'
        'colmap': ``cameras.txt``, ``images.txt`` and ``points3D.txt``. 'colmap_binary': the same
        files as ``.bin``. 'transforms': ``transforms.json``, of instant-ngp and nerfstudio.
        'ply': the points, ``points.ply``.
    images : str, default 'images'
        Folder of the photographs beside ``transforms.json``, whose names are then
        ``images/NAME``; '' for the folder of the file itself.

    Returns
    -------
    list of Path
        The files that were written.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist.
    TypeError
        If `reconstruction` is not a Reconstruction, an array of it does not hold real numbers, or
        `images` is not a str.
    ValueError
        If `format` is unknown, an array of `reconstruction` has another shape than the class says,
        is not finite (poses may be NaN) or points to what is not there, no photograph has a place,
        or a lens has a k3, which these formats cannot hold.

    See Also
    --------
    cvkern.radiance.load_scene : Read the cameras with the photographs.

    Notes
    -----
    These formats measure places from the corner of the first pixel, half a pixel from its centre.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import cvkern
    >>> camera = cvkern.Camera([[50, 0, 32], [0, 50, 24], [0, 0, 1]], shape=(48, 64))
    >>> made = cvkern.Reconstruction(
    ...     ("a.png", "b.png"), np.stack([np.eye(3, 4)] * 2), (camera,), np.zeros(2, int),
    ...     np.ones((1, 3)), np.zeros((1, 3), np.uint8), np.array([[0, 0], [0, 1]], np.int32),
    ...     np.full((2, 2), 20.0), np.zeros(1))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = cvkern.write_reconstruction(folder, made)
    ...     cvkern.read_reconstruction(folder)
    Reconstruction(2 of 2 photographs, 1 points)
    """
    check_choice(format, FORMATS, "format")
    check_instance(reconstruction, Reconstruction, "reconstruction")
    check_instance(images, str, "images")
    reconstruction = checked(reconstruction)
    folder = as_path(path)
    if not folder.is_dir():
        raise FileNotFoundError(f"path must be a folder that exists, got {str(folder)!r}")
    if format == "ply":
        from cvkern.clouds import write_ply

        write_ply(folder / CLOUD, reconstruction.points, reconstruction.colors)
        return [folder / CLOUD]
    if not len(reconstruction.placed):
        raise ValueError("reconstruction must have a placed photograph, got none")
    used = np.unique(reconstruction.lens_of[reconstruction.placed])
    bent = [float(reconstruction.lenses[n].distortion[4]) for n in used]
    if any(bent):
        raise ValueError(f"reconstruction must have lenses with k3 = 0 for this format, got {bent}")
    if format == "transforms":
        write_text(
            folder / TRANSFORMS, json.dumps(_frames(reconstruction, images), indent=1) + "\n"
        )
        return [folder / TRANSFORMS]
    written = []
    for name in COLMAP:
        if format == "colmap":
            file = folder / f"{name}.txt"
            write_text(file, _TEXTS[name](reconstruction))
        else:
            file = folder / f"{name}.bin"
            with replacing(file) as beside:
                beside.write_bytes(_BYTES[name](reconstruction))
        written.append(file)
    return written


def read_reconstruction(path: str | os.PathLike[str]) -> Reconstruction:
    """Read a reconstruction of COLMAP, as text or binary.

    Parameters
    ----------
    path : str or path
        Folder with ``cameras``, ``images`` and ``points3D``, ``.bin`` or ``.txt``; or a folder that
        has them in ``sparse/0`` or ``sparse``.

    Returns
    -------
    Reconstruction
        In the order of the photographs' names, all of them placed. The world is that of the file.

    Raises
    ------
    FileNotFoundError
        If a file is missing.
    ValueError
        If a file is damaged, or has a lens other than SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL,
        RADIAL and OPENCV.

    Examples
    --------
    See :func:`write_reconstruction`.
    """
    folder = as_path(path)
    for model in (folder / "sparse" / "0", folder / "sparse", folder):
        for ending in (".bin", ".txt"):
            files = [model / f"{name}{ending}" for name in COLMAP]
            if files[0].exists():
                missing = [file for file in files if not file.exists()]
                if missing:
                    raise FileNotFoundError(f"path must hold {missing[0].name} beside {files[0]}")
                try:
                    return _read(files, ending == ".bin")
                except (struct.error, IndexError, UnicodeDecodeError, KeyError) as error:
                    raise ValueError(f"{model} must be a whole COLMAP model: {error}") from None
    raise FileNotFoundError(f"path must hold a COLMAP model, got {str(folder)!r}")


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return w, x, y, z of a rotation, w >= 0."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    found = np.array([w, x, y, z])
    return found if w >= 0 else -found


def _places(made: Reconstruction) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Return the placed photographs, with (x, y) from the corner and the points that they show."""
    found = []
    for view in made.placed:
        own = made.tracks[:, 1] == view
        found.append((int(view), made.places[own][:, ::-1] + 0.5, made.tracks[own, 0]))
    return found


def _pose_numbers(made: Reconstruction, view: int) -> list[float]:
    turn = made.poses[view, :, :3].T
    return [*quaternion(turn).tolist(), *(-turn @ made.poses[view, :, 3]).tolist()]


def _lens_numbers(camera: Camera) -> list[float]:
    fx, fy, cx, cy = focal_and_center(camera.matrix)
    return [float(v) for v in (fx, fy, cx + 0.5, cy + 0.5, *camera.distortion[:4])]


def _lens_names(made: Reconstruction) -> list[int]:
    return sorted(set(made.lens_of[made.placed].tolist()))


def _text(values: Any) -> str:
    return " ".join(repr(v) if isinstance(v, float) else str(v) for v in values)


def _cameras_text(made: Reconstruction) -> str:
    lines = ["# CAMERA_ID MODEL WIDTH HEIGHT PARAMS"]
    for n in _lens_names(made):
        height, width = made.lenses[n].shape
        lines.append(_text([n + 1, "OPENCV", width, height, *_lens_numbers(made.lenses[n])]))
    return "\n".join(lines) + "\n"


def _images_text(made: Reconstruction) -> str:
    lines = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", "# X Y POINT3D_ID, as often as seen"]
    for view, places, points in _places(made):
        head = [view + 1, *_pose_numbers(made, view), int(made.lens_of[view]) + 1, made.names[view]]
        lines.append(_text(head))
        seen = [
            _text((x, y, p + 1)) for (x, y), p in zip(places.tolist(), points.tolist(), strict=True)
        ]
        lines.append(" ".join(seen))
    return "\n".join(lines) + "\n"


def _seen_by(made: Reconstruction) -> list[list[tuple[int, int]]]:
    """Return the photographs of each point, and the number of its place in each."""
    found: list[list[tuple[int, int]]] = [[] for _ in made.points]
    for view, _, points in _places(made):
        for number, p in enumerate(points.tolist()):
            found[p].append((view + 1, number))
    return found


def _points_text(made: Reconstruction) -> str:
    lines = ["# POINT3D_ID X Y Z R G B ERROR, then IMAGE_ID POINT2D_IDX as often as seen"]
    rows = zip(
        made.points.tolist(), made.colors.tolist(), made.errors.tolist(), _seen_by(made),
        strict=True,
    )  # fmt: skip
    for n, (point, color, error, seen) in enumerate(rows, 1):
        lines.append(_text([n, *point, *color, error, *(v for pair in seen for v in pair)]))
    return "\n".join(lines) + "\n"


def _cameras_bytes(made: Reconstruction) -> bytes:
    names = _lens_names(made)
    parts = [struct.pack("<Q", len(names))]
    for n in names:
        height, width = made.lenses[n].shape
        parts.append(struct.pack("<iiQQ", n + 1, OPENCV, width, height))
        parts.append(struct.pack("<8d", *_lens_numbers(made.lenses[n])))
    return b"".join(parts)


def _images_bytes(made: Reconstruction) -> bytes:
    parts = [struct.pack("<Q", len(made.placed))]
    for view, places, points in _places(made):
        lens = int(made.lens_of[view]) + 1
        parts.append(struct.pack("<i7di", view + 1, *_pose_numbers(made, view), lens))
        parts.append(made.names[view].encode() + b"\0")
        seen = np.zeros(len(points), np.dtype([("at", "<f8", 2), ("point", "<i8")]))
        seen["at"], seen["point"] = places, points + 1
        parts += [struct.pack("<Q", len(points)), seen.tobytes()]
    return b"".join(parts)


def _points_bytes(made: Reconstruction) -> bytes:
    parts = [struct.pack("<Q", len(made.points))]
    for n, seen in enumerate(_seen_by(made)):
        head = (n + 1, *made.points[n], *made.colors[n].tolist(), made.errors[n], len(seen))
        parts.append(struct.pack("<Q3d3BdQ", *head))
        parts.append(np.array(seen, "<i4").tobytes())
    return b"".join(parts)


_TEXTS = dict(zip(COLMAP, (_cameras_text, _images_text, _points_text), strict=True))
_BYTES = dict(zip(COLMAP, (_cameras_bytes, _images_bytes, _points_bytes), strict=True))


def _frames(made: Reconstruction, images: str) -> dict[str, Any]:
    """Return the content of ``transforms.json``; frames name their lens if there are several."""

    def lens(n: int) -> dict[str, Any]:
        height, width = made.lenses[n].shape
        names = ("fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2")
        numbers = dict(zip(names, _lens_numbers(made.lenses[n]), strict=True))
        return {"camera_model": "OPENCV", "w": width, "h": height, **numbers}

    names = _lens_names(made)
    frames = []
    for view in made.placed.tolist():
        pose = np.vstack((made.poses[view], [0, 0, 0, 1]))
        pose[:, 1:3] *= -1  # OpenGL's axes: y up, z backward
        frame = {"file_path": f"{images}/{made.names[view]}" if images else made.names[view]}
        frame |= lens(int(made.lens_of[view])) if len(names) > 1 else {}
        frames.append({**frame, "transform_matrix": pose.tolist()})
    return {**(lens(names[0]) if len(names) == 1 else {}), "frames": frames}


View = tuple[int, str, int, tuple[float, ...], np.ndarray, np.ndarray]


def _read(files: list[Path], binary: bool) -> Reconstruction:
    lenses = (_colmap._binary_cameras if binary else _colmap._text_cameras)(files[0])
    views = sorted((_binary_views if binary else _text_views)(files[1]), key=lambda v: v[1])
    names, points, colors, errors = (_binary_points if binary else _text_points)(files[2])
    if len(set(names.tolist())) < len(names):
        raise ValueError(f"{files[2]} must have different points, got one twice")
    made, number_of = [], {}
    for name in sorted(lenses):
        _, width, height, _ = lenses[name]
        lens, bent = _colmap._lens(lenses[name], width, height, files[0])
        number_of[name] = len(made)
        try:
            made.append(Camera(matrix_of(*lens), bent, (height, width)))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{files[0]}: {error}") from None
    point_of = {int(name): n for n, name in enumerate(names)}
    poses, lens_of, tracks, places = [], [], [np.zeros((0, 2), np.int32)], [np.zeros((0, 2))]
    for n, (_, _, lens, place, where, shown) in enumerate(views):
        if not np.isfinite(place).all() or not any(place[:4]):
            raise ValueError(f"{files[1]} must have finite poses, got {place}")
        poses.append(_colmap._pose(place))
        lens_of.append(number_of[lens])
        kept = shown >= 0
        own = np.array([point_of[int(p)] for p in shown[kept]], np.int32)
        tracks.append(np.stack((own, np.full(len(own), n, np.int32)), axis=1))
        places.append(where[kept][:, ::-1] - 0.5)
    whole, at = np.concatenate(tracks), np.concatenate(places)
    order = np.lexsort((whole[:, 1], whole[:, 0]))
    return Reconstruction(
        tuple(v[1] for v in views), np.array(poses).reshape(-1, 3, 4), tuple(made),
        np.array(lens_of, np.int64), points, colors, whole[order], at[order], errors,
    )  # fmt: skip


def _text_views(file: Path) -> list[View]:
    lines = list(_colmap._lines(file))
    found = []
    for head, seen in zip(lines[::2], [*lines[1::2], []], strict=False):
        if not head:
            continue
        place = tuple(_colmap._number(v, file) for v in head[1:8])
        numbers = np.array([_colmap._number(v, file) for v in seen]).reshape(-1, 3)
        names = _colmap._integer(head[0], file), " ".join(head[9:]), _colmap._integer(head[8], file)
        found.append((*names, place, numbers[:, :2], numbers[:, 2].astype(np.int64)))
    return found


def _binary_views(file: Path) -> list[View]:
    data, found = _colmap._Bytes(file), []
    for _ in range(data.take("Q")[0]):
        name, *place, camera = data.take("i7di")
        text = data.text()
        count = data.take("Q")[0]
        begin = data.at
        data.skip(24 * count)
        kind = np.dtype([("at", "<f8", 2), ("point", "<i8")])
        seen = np.frombuffer(data.data, kind, count, begin)
        found.append((name, text, camera, tuple(place), seen["at"].copy(), seen["point"].copy()))
    return found


Cloud = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _text_points(file: Path) -> Cloud:
    rows = [
        [_colmap._number(v, file) for v in words[:8]] for words in _colmap._lines(file) if words
    ]
    return _cloud(np.array(rows, np.float64).reshape(-1, 8), file)


def _binary_points(file: Path) -> Cloud:
    data, rows = _colmap._Bytes(file), []
    for _ in range(data.take("Q")[0]):
        *row, count = data.take("Q3d3BdQ")
        rows.append(row)
        data.skip(8 * count)
    return _cloud(np.array(rows, np.float64).reshape(-1, 8), file)


def _cloud(rows: np.ndarray, file: Path) -> Cloud:
    if not np.isfinite(rows).all() or (rows[:, 4:7] < 0).any() or (rows[:, 4:7] > 255).any():
        raise ValueError(f"{file} must have finite points with colours of 0 to 255")
    return (
        rows[:, 0].astype(np.int64),
        rows[:, 1:4].copy(),
        rows[:, 4:7].astype(np.uint8),
        rows[:, 7],
    )
