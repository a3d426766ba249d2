"""Reading and writing of calibrations: JSON, and the files of OpenCV."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from cvkern._files import write_text
from cvkern.geometry.cameras.calibration import Calibration
from cvkern.geometry.cameras.lens import Camera, check_pose
from cvkern.geometry.cameras.stereo_calibration import StereoCalibration

LARGEST_FILE = 2**24  # bytes: calibrations have some thousands
_MATRIX = re.compile(
    r"(?:rows:\s*(\d+)\s+cols:\s*(\d+)|sizes:\s*\[([^\]]*)\])\s+dt:\s*\"?\w+\"?\s+"
    r"data:\s*\[([^\]]*)\]",
    re.DOTALL,
)
_KINDS = ("opencv-matrix", "opencv-nd-matrix")  # the second one is what OpenCV 5 makes of a vector
_NOT_FINITE = re.compile(r"(?<=[\s\[,:])(-?)\.(Nan|Inf)\b")  # these are no JSON
_ENTRY = re.compile(r"^(\w+):", re.MULTILINE)
_JSON, _YAML, _XML = (".json",), (".yml", ".yaml"), (".xml",)
# Other names of entries: OpenCV 2, tutorials, samples for structured light, and procam-calibration,
# which misspells one.
_ALIASES = {
    "camera_matrix": ("Camera_Matrix", "cameraMatrix", "mtx", "K"),
    "distortion_coefficients": ("Distortion_Coefficients", "distCoeffs", "dist", "D"),
    "image_width": ("image_Width",),
    "image_height": ("image_Height",),
    "avg_reprojection_error": ("Avg_Reprojection_Error", "rms"),
    "M1": ("cameraMatrix1", "K1", "cam1_intrinsics", "cam_int"),
    "D1": ("distCoeffs1", "cam1_distorsion", "cam_dist"),
    "M2": ("cameraMatrix2", "K2", "cam2_intrinsics", "proj_int"),
    "D2": ("distCoeffs2", "cam2_distorsion", "proj_dist"),
    "R": ("rotation", "roration"),  # codespell:ignore roration
    "T": ("translation",),
}


def write_calibration(
    path: str | os.PathLike[str], calibration: Calibration | StereoCalibration
) -> None:
    """Write a calibration to a file.

    Parameters
    ----------
    path : path
        A path that ends in .json, or in .yml or .yaml for the format of OpenCV's ``FileStorage``.
        The file is written whole or not at all; an older one is replaced.
    calibration : Calibration or StereoCalibration
        The file has the cameras, `rms` and `deviations`, and for two cameras also `rotation` and
        `translation`. It does not have the poses of boards.

    Raises
    ------
    TypeError
        If `calibration` is neither of the two.
    ValueError
        If `path` has an unknown ending, or is not a regular file.
    OSError
        If the file cannot be written.

    See Also
    --------
    read_calibration : The inverse.

    Notes
    -----
    In YAML one camera has the entries `camera_matrix` and `distortion_coefficients`, as in OpenCV's
    samples. Two cameras have `M1`, `D1`, `M2`, `D2`, `R` and `T`; the image size of the second one
    is `image_width2` and `image_height2`.

    Examples
    --------
    >>> import os, tempfile
    >>> import cvkern
    >>> board = cvkern.chessboard_points((4, 5))
    >>> camera = cvkern.Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], [-0.1], (480, 640))
    >>> turns = [(0.5, 0, 0), (0, 0.5, 0), (-0.3, -0.4, 0.2)]
    >>> views = [cvkern.project_points(board, camera, turn, (-2, -1.5, 9)) for turn in turns]
    >>> found = cvkern.calibrate_camera(board, views, (480, 640))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     cvkern.write_calibration(os.path.join(folder, "camera.yml"), found)
    ...     again = cvkern.read_calibration(os.path.join(folder, "camera.yml"))
    >>> bool((again.matrix == found.matrix).all())
    True
    """
    ending = _ending(path, _JSON + _YAML)
    if isinstance(calibration, StereoCalibration):
        cameras = {"M1 D1": calibration.left, "M2 D2": calibration.right}
    elif isinstance(calibration, Calibration):
        cameras = {"camera_matrix distortion_coefficients": calibration.camera}
    else:
        said = type(calibration).__name__
        raise TypeError(f"calibration must be a Calibration or a StereoCalibration, got {said}")
    shape = next(iter(cameras.values())).shape
    values: dict[str, Any] = {"image_width": shape[1], "image_height": shape[0]}
    for names, camera in cameras.items():
        matrix, distortion = names.split()
        values[matrix], values[distortion] = camera.matrix, camera.distortion[None]
    if isinstance(calibration, StereoCalibration):
        rows, columns = calibration.right.shape
        values |= {"image_width2": columns, "image_height2": rows}
        values |= {"R": calibration.rotation, "T": calibration.translation[:, None]}
    values["avg_reprojection_error"] = float(calibration.rms)
    values["standard_deviations"] = calibration.deviations[None]
    if ending in _JSON:
        plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values.items()}
        rows = [f"  {json.dumps(k)}: {json.dumps(_none(v))}" for k, v in plain.items()]
        write_text(path, "{\n" + ",\n".join(rows) + "\n}\n")
    else:
        write_text(path, "%YAML:1.0\n---\n" + "".join(_entry(k, v) for k, v in values.items()))


def read_calibration(
    path: str | os.PathLike[str],
    shape: tuple[int, int] | None = None,
    *,
    right_shape: tuple[int, int] | None = None,
) -> Calibration | StereoCalibration:
    """Read a calibration from a file.

    Parameters
    ----------
    path : path
        A file of :func:`write_calibration`, or one that OpenCV's ``FileStorage`` wrote as XML,
        YAML or JSON, with `camera_matrix` and `distortion_coefficients`, or with `M1`, `D1`, `M2`,
        `D2`, `R` and `T`; or under the names that OpenCV's other samples give them.
    shape : (int, int), optional
        Rows and columns of the images, for files without them; of the first camera, if there are
        two.
    right_shape : (int, int), optional
        Rows and columns of the images of the second camera, or of a projector, for files without
        them. By default those of the first.

    Returns
    -------
    Calibration or StereoCalibration
        The calibration without poses of boards. `rms` and `deviations` are NaN if the file does not
        have them.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file has an unknown ending or format, lacks a matrix or the size of the images, or
        has numbers that are not a camera.

    Examples
    --------
    See :func:`write_calibration`.
    """
    ending = _ending(path, _JSON + _YAML + _XML)
    if Path(path).stat().st_size > LARGEST_FILE:
        raise ValueError(f"path must be a file of a calibration, got {os.fspath(path)!r}: too long")
    name = os.fspath(path)
    try:
        text = Path(path).read_text(encoding="utf-8")
        values = (_from_json if ending in _JSON else _from_xml if ending in _XML else _from_yaml)(
            text
        )
        return _calibration(_named(values), shape, right_shape)
    except (
        ValueError, TypeError, KeyError, OverflowError, RecursionError, ElementTree.ParseError,
    ) as error:  # fmt: skip
        said = str(error) if not isinstance(error, KeyError) else f"{error.args[0]} is missing"
        raise ValueError(f"{name}: no calibration: {said}") from None


def _ending(path: str | os.PathLike[str], known: tuple[str, ...]) -> str:
    ending = Path(path).suffix.lower()
    if ending not in known:
        said = f"{', '.join(known[:-1])} or {known[-1]}"
        raise ValueError(f"path must end in {said}, got {os.fspath(path)!r}")
    return ending


def _none(value: Any) -> Any:
    """Return null for NaN, which JSON does not have."""
    if isinstance(value, list):
        return [_none(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _entry(name: str, value: Any) -> str:
    """Write an entry as OpenCV does."""
    if not isinstance(value, np.ndarray):
        return f"{name}: {_number(value)}\n"
    numbers = ", ".join(_number(float(v)) for v in value.ravel())
    rows, columns = value.shape
    return (
        f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n"
        f"   data: [ {numbers} ]\n"
    )


def _number(value: float) -> str:
    if isinstance(value, int):
        return str(value)
    return repr(value) if math.isfinite(value) else ".Nan"


def _from_json(text: str) -> dict[str, Any]:
    text = _NOT_FINITE.sub(lambda m: m[1] + {"Nan": "NaN", "Inf": "Infinity"}[m[2]], text)
    values = json.loads(text)
    if not isinstance(values, dict):
        raise ValueError("it is no object of names and values")
    return {name: _of_opencv(name, value) for name, value in values.items()}


def _of_opencv(name: str, value: Any) -> Any:
    """Return the matrix that OpenCV writes into JSON as an object."""
    if not isinstance(value, dict) or value.get("type_id") not in _KINDS:
        return value
    sides = value["sizes"] if "sizes" in value else (value["rows"], value["cols"])
    return _matrix(name, sides, value["data"])


def _matrix(name: str, sides: Iterable[Any], numbers: Sequence[Any]) -> np.ndarray:
    shape = [int(side) for side in sides]
    if len(numbers) != math.prod(shape):
        said = f"{name} must have {' x '.join(map(str, shape))} numbers"
        raise ValueError(f"{said}, got {len(numbers)}")
    return np.reshape([float(_plain(str(n))) for n in numbers], shape)


def _from_xml(text: str) -> dict[str, Any]:
    """Read the numbers and matrices of the outermost level, and leave out all else."""
    if "<!" in text.replace("<!--", ""):  # entities can stand for more than memory holds
        raise ValueError("it has a document type, which OpenCV does not write")
    root = ElementTree.fromstring(text)
    if root.tag != "opencv_storage":
        raise ValueError(f"its root must be opencv_storage, got {root.tag}")
    values: dict[str, Any] = {}
    for entry in root:
        if entry.get("type_id") in _KINDS:
            rows, columns, sizes, data = (
                entry.findtext(part) for part in ("rows", "cols", "sizes", "data")
            )
            sides = sizes.split() if sizes else (rows, columns)
            if data is None or None in sides:
                raise ValueError(f"{entry.tag} is no whole matrix")
            values[entry.tag] = _matrix(entry.tag, sides, data.split())
        elif not len(entry):
            body = (entry.text or "").strip()
            try:
                values[entry.tag] = float(_plain(body))
            except ValueError:
                values[entry.tag] = body
    return values


def _from_yaml(text: str) -> dict[str, Any]:
    """Read the numbers and matrices of the outermost level, and leave out all else."""
    if not text.startswith("%YAML"):
        raise ValueError("it does not begin with %YAML")
    values: dict[str, Any] = {}
    heads = list(_ENTRY.finditer(text))
    ends = [*[head.start() for head in heads][1:], len(text)]
    for head, end in zip(heads, ends, strict=False):
        body = text[head.end() : end].strip()
        if body.startswith(tuple(f"!!{kind}" for kind in _KINDS)):
            found = _MATRIX.search(body)
            if not found:
                raise ValueError(f"{head.group(1)} is no whole matrix")
            rows, columns, sizes, data = found.groups()
            sides = sizes.split(",") if sizes else (rows, columns)
            values[head.group(1)] = _matrix(head.group(1), sides, data.replace(",", " ").split())
        else:
            try:
                values[head.group(1)] = float(_plain(body))
            except ValueError:
                values[head.group(1)] = body
    return values


def _plain(number: str) -> str:
    return number.strip().lower().replace(".nan", "nan").replace(".inf", "inf")


def _named(values: dict[str, Any]) -> dict[str, Any]:
    """Return the entries under the names that are written, whatever names the file has for them."""
    found = dict(values)
    for name, others in _ALIASES.items():
        there = [other for other in others if other in values]
        if there and name not in found:
            found[name] = values[there[0]]
    size = np.ravel(found.get("img_shape", ()))
    if "image_height" not in found and len(size) == 2:
        found["image_height"], found["image_width"] = size.tolist()
    return found


def _calibration(
    values: dict[str, Any],
    shape: tuple[int, int] | None,
    right_shape: tuple[int, int] | None,
) -> Calibration | StereoCalibration:
    if "image_height" in values and "image_width" in values and shape is None:
        shape = _side(values["image_height"]), _side(values["image_width"])
    if shape is None:
        raise ValueError("it does not say the size of the images, and shape is not given")
    rms = values.get("avg_reprojection_error")
    rms = math.nan if rms is None else float(rms)
    if "M1" in values:
        other = right_shape or shape
        if right_shape is None and "image_height2" in values and "image_width2" in values:
            other = _side(values["image_height2"]), _side(values["image_width2"])
        left, right = (
            Camera(_array(values, f"M{n}", (3, 3)), _array(values, f"D{n}"), sides)
            for n, sides in ((1, shape), (2, other))
        )
        turn, shift = check_pose(_array(values, "R", (3, 3)), _array(values, "T", (3,)))
        if not np.any(shift):
            raise ValueError("T must not be 0")
        none = np.zeros((0, 3, 3)), np.zeros((0, 3))
        return StereoCalibration(left, right, turn, shift, rms, *none, _spread(values, 24))
    name = "distortion_coefficients"
    camera = Camera(_array(values, "camera_matrix", (3, 3)), _array(values, name), shape)
    none = np.zeros((0, 3, 3)), np.zeros((0, 3))
    return Calibration(camera, rms, *none, _spread(values, 9), np.zeros(0))


def _side(value: Any) -> int:
    number = float(value)
    if number != round(number):
        raise ValueError(f"image_width and image_height must be whole, got {value}")
    return int(number)


def _array(values: dict[str, Any], name: str, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """Return finite numbers of a shape, or in a row."""
    found = np.asarray(values[name], np.float64)
    if shape is not None and found.size == math.prod(shape):
        found = found.reshape(shape)
    elif shape is not None:
        raise ValueError(f"{name} must have shape {shape}, got {found.shape}")
    if not np.isfinite(found).all():
        raise ValueError(f"{name} must be finite")
    return found


def _spread(values: dict[str, Any], count: int) -> np.ndarray:
    """Return standard deviations, or NaN."""
    found = values.get("standard_deviations")
    spread = np.full(count, np.nan) if found is None else np.asarray(found, np.float64).ravel()
    return spread if len(spread) == count else np.full(count, np.nan)
