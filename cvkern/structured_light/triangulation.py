"""Triangulation of projector columns and laser lines to points in space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._checks import (
    FLOAT32_MAX,
    as_items,
    as_numbers,
    check_choice,
    check_image,
    check_integer,
    refuse_masks,
)
from cvkern._runtime import runtime
from cvkern.geometry._matrices import check_matrix
from cvkern.geometry._points import check_points, on_host, xy
from cvkern.geometry.cameras.calibration import host_points, numbers_of
from cvkern.geometry.cameras.lens import Camera, check_lens, rays_of, turned
from cvkern.geometry.cameras.stereo_calibration import (
    Seen,
    StereoCalibration,
    calibrate_two,
    check_stereo,
)
from cvkern.geometry.fitting import fit_homography
from cvkern.structured_light.patterns import AXES

NEARBY = 15  # reach in pixels of the local homography from a corner to the projector
LEAST_KNOWN = 20  # least number of pixels with known codes in this reach
FLATTEST = 1e-3  # sine of the angle between a ray and the laser's plane


def triangulate_columns(
    columns: Any, calibration: StereoCalibration, valid: Any = None, *, axis: str = "columns"
) -> Any:
    """Return the point in space that each pixel of a camera sees under a projector.

    Parameters
    ----------
    columns : array of shape (H, W)
        Column of the projector that lights each pixel, from :func:`decode_gray_code` or
        :func:`decode_phase_shift`; NaN or below -0.5 where it is unknown.
    calibration : StereoCalibration
        The camera as `left` and the projector as `right`, from :func:`calibrate_projector`.
    valid : array of shape (H, W), optional
        Pixels to use are not 0.
    axis : {'columns', 'rows'}, default 'columns'
        The meaning of `columns`. Use rows if the projector stands above or below the camera.

    Returns
    -------
    array of shape (H, W, 3), float32
        (X, Y, Z) in camera axes (x right, y down, z forward), in the unit of the calibration. NaN
        where the column is unknown, or where ray and plane meet behind the camera or the projector.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or `calibration` is not a StereoCalibration.
    ValueError
        If `columns` does not have the shape of the camera, `valid` does not have the shape of
        `columns`, or `axis` is unknown.

    See Also
    --------
    triangulate_lines : The same for laser lines.

    Notes
    -----
    A column of a projector lights a plane, and the ray of the pixel meets it in one point. If the
    projector has a lens, the column is a curve, and at most four steps of Newton's method find the
    point.

    Examples
    --------
    >>> import cvkern
    >>> scan = cvkern.make_scan("phase_shift", (24, 32))
    >>> found = cvkern.decode_phase_shift(scan.frames, scan.calibration.right.shape)
    >>> points = cvkern.triangulate_columns(found.columns, scan.calibration, found.valid)
    >>> points.shape
    (24, 32, 3)
    """
    calibration = check_stereo(calibration)
    columns = check_image(columns, name="columns")
    number = AXES.index(check_choice(axis, AXES, "axis"))
    shape = tuple(columns.shape)
    if shape != calibration.left.shape:
        raise ValueError(
            f"columns must have the shape of the camera, {calibration.left.shape}, got {shape}"
        )
    if valid is not None:
        valid = check_image(valid, name="valid")
        if tuple(valid.shape) != shape:
            raise ValueError(f"valid must have shape {shape}, got {tuple(valid.shape)}")
    rt = runtime(columns, *([] if valid is None else [valid]))
    lenses = np.stack([numbers_of(c) for c in (calibration.left, calibration.right)])
    pose = np.concatenate((calibration.rotation.ravel(), calibration.translation))
    result = rt.empty((*shape, 3))
    mask = rt.constant(np.ones((1, 1), np.uint8)) if valid is None else rt.adopt_mask(valid)
    rt.structured_light.triangulation.intersect(
        rt.adopt(columns), mask, rt.constant(lenses.astype(np.float32)),
        rt.constant(pose.astype(np.float32)), number, rt.adopt(result),
    )  # fmt: skip
    return rt.release(result)


def calibrate_projector(
    object_points: Any,
    image_points: Sequence[Any],
    decoded: Sequence[Any],
    shape: tuple[int, int],
    projector_shape: tuple[int, int],
    *,
    camera: Camera | None = None,
    fixed: Sequence[str] = (),
) -> StereoCalibration:
    """Calibrate a projector and its pose beside a camera, from views of a board that it lights.

    Parameters
    ----------
    object_points : array of shape (N, 3), or a sequence of V such arrays
        As in :func:`calibrate_camera`.
    image_points : sequence of V arrays of shape (N, 2)
        Row and column of these points in the camera's images.
    decoded : sequence of V results
        Projector coordinates in each view, from :func:`decode_gray_code` or
        :func:`decode_phase_shift`, with columns and rows.
    shape, projector_shape : (int, int)
        Rows and columns of the camera's images and of the projector.
    camera : Camera, optional
        The camera, if it is known. It is then not changed.
    fixed : sequence of str, default ()
        Parameters that stay fixed in both, as in :func:`calibrate_camera`.

    Returns
    -------
    StereoCalibration
        The camera as `left`, the projector as `right`.

    Raises
    ------
    TypeError, ValueError
        As :func:`calibrate_stereo`; also if a view has too few known pixels about a point.

    Notes
    -----
    A projector is a camera with the light reversed. A homography, fitted to the codes of the known
    pixels up to 15 pixels around a point of the board, gives the place where the projector would
    see that point [1]_.

    References
    ----------
    .. [1] D. Moreno and G. Taubin, "Simple, accurate, and robust projector-camera calibration",
       3DIMPVT 2012.

    Examples
    --------
    With `photographs` of a board in several poses under the patterns of
    :func:`gray_code_patterns`, each a stack of K images::

        decoded = [cvkern.decode_gray_code(stack[:-2], (768, 1024), *stack[-2:])
                   for stack in photographs]
        corners = [cvkern.detect_chessboard(stack[-2], (7, 9)) for stack in photographs]
        board = cvkern.chessboard_points((7, 9), 75.0)
        found = cvkern.calibrate_projector(board, corners, decoded, (1024, 1280), (768, 1024))
    """
    views = as_items(image_points, "image_points", "a sequence of arrays")
    codes = as_items(decoded, "decoded", "a sequence of results")
    if len(codes) != len(views):
        raise ValueError(
            f"decoded must be of as many views as image_points, {len(views)}, got {len(codes)}"
        )
    lit = [
        _lit(points, found, n) for n, (points, found) in enumerate(zip(views, codes, strict=True))
    ]
    seen = Seen("image_points", views, "camera"), Seen("decoded", lit, "decoded")
    shapes = shape, projector_shape
    return calibrate_two(object_points, seen, shapes, (camera, None), fixed, fix_cameras=False)


def _lit(points: Any, found: Any, number: int) -> np.ndarray:
    """Return the projector rows and columns that light points of an image."""
    corners = host_points(points, f"image_points[{number}]", 2)
    if not all(hasattr(found, name) for name in ("columns", "rows", "valid")):
        said = type(found).__name__
        raise TypeError(f"decoded[{number}] must be a GrayCode or a PhaseShift, got {said}")
    if found.columns is None or found.rows is None:
        raise ValueError(f"decoded[{number}] must have columns and rows, got one of them")
    columns, rows, valid = (np.asarray(a) for a in (found.columns, found.rows, found.valid))
    lit = []
    for corner in corners:
        low = np.maximum(np.round(corner).astype(int) - NEARBY, 0)
        part = np.s_[low[0] : low[0] + 2 * NEARBY + 1, low[1] : low[1] + 2 * NEARBY + 1]
        near = np.argwhere(valid[part] != 0)
        if len(near) < LEAST_KNOWN:
            raise ValueError(
                f"decoded[{number}] must have {LEAST_KNOWN} valid pixels within {NEARBY} of "
                f"{corner.round(1).tolist()}, got {len(near)}"
            )
        codes = np.stack((rows[part], columns[part]), axis=2)[near[:, 0], near[:, 1]]
        matrix = fit_homography(near + low - corner, codes)
        lit.append(matrix[1::-1, 2] / matrix[2, 2])
    return np.array(lit)


def fit_laser_plane(
    lines: Sequence[Any], camera: Camera, rotations: Any, translations: Any
) -> np.ndarray:
    """Fit the plane of a laser to its lines on a board in several poses.

    Parameters
    ----------
    lines : sequence of V arrays of shape (N, 2)
        Row and column of points of the line in each view. Points with NaN are ignored.
    camera : Camera
        The camera of the views.
    rotations, translations : array of shape (V, 3, 3), array of shape (V, 3)
        Poses of the board from :func:`calibrate_camera`: X = R W + t, with the board at Z = 0.

    Returns
    -------
    numpy.ndarray of shape (4,), float64
        (a, b, c, d) with a X + b Y + c Z = d in camera axes; (a, b, c) has length 1, and d >= 0.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or `camera` is not a Camera.
    ValueError
        If shapes do not match, or the points lie on one line: give boards in two poses.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> camera = cvkern.Camera([[100, 0, 50], [0, 100, 40], [0, 0, 1]], shape=(80, 100))
    >>> line = np.stack((np.arange(80.0), np.full(80, 50.0)), axis=1)  # straight ahead, X = 0
    >>> poses = np.stack([np.eye(3)] * 2), [(0, 0, 5.0), (0, 0, 7.0)]
    >>> cvkern.fit_laser_plane([line, line], camera, *poses).round(6) + 0
    array([1., 0., 0., 0.])
    """
    camera = check_lens(camera)
    turns = check_matrix(rotations, (-1, 3, 3), "rotations")
    shifts = check_matrix(translations, (-1, 3), "translations")
    views = as_items(lines, "lines", "a sequence of arrays")
    if not len(views) == len(turns) == len(shifts):
        raise ValueError(
            f"rotations and translations must be of as many views as lines, {len(views)}, "
            f"got {len(turns)} and {len(shifts)}"
        )
    parts = []
    for n, (line, turn, shift) in enumerate(zip(views, turns, shifts, strict=True)):
        line = check_points(line, f"lines[{n}]")
        places = on_host(runtime(line), line)
        rays = rays_of(xy(places[np.isfinite(places).all(axis=1)]), camera)
        normal = turn[:, 2]
        found = rays * (normal @ shift / (rays @ normal))[:, None]
        parts.append(found[np.isfinite(found).all(axis=1)])
    points = np.concatenate(parts)
    if len(points) < 3:
        raise ValueError(f"lines must have 3 points at least, got {len(points)}")
    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle, full_matrices=False)
    if not sizes[1] > FLATTEST * sizes[0]:
        raise ValueError("lines must not lie on one line in space, got a board in one pose")
    normal = axes[2]
    away = float(normal @ middle)
    sign = (
        1.0
        if away > 1e-12 or (abs(away) <= 1e-12 and normal[np.abs(normal).argmax()] > 0)
        else -1.0
    )
    return sign * np.append(normal, away)


def triangulate_lines(
    positions: Any,
    camera: Camera,
    plane: Any,
    *,
    axis: int = 0,
    angles: Any = None,
    pivot: Any = None,
    spindle: Any = (0.0, -1.0, 0.0),
) -> Any:
    """Triangulate laser lines to points in space.

    Parameters
    ----------
    positions : array of shape (lines,) or (N, lines)
        Position of the line in each column (`axis` 0) or row (1) of one frame or of a stack, from
        :func:`detect_laser_lines`; NaN where there is none.
    camera : Camera
        The camera of the frames.
    plane : array of shape (4,)
        (a, b, c, d) of :func:`fit_laser_plane`.
    axis : {0, 1}, default 0
        The `axis` that :func:`detect_laser_lines` was called with.
    angles : array of shape (N,), optional
        Angle of the turn-table in each frame, radians, right-handed about `spindle`. The points are
        turned back by it.
    pivot : array of shape (3,), optional
        A point on the axis of the turn-table, in camera axes; required with `angles`.
    spindle : array of shape (3,), default (0, -1, 0)
        Direction of that axis.

    Returns
    -------
    array of shape (lines, 3) or (N, lines, 3), float32
        (X, Y, Z) in camera axes, in the unit of the plane; NaN where there is no line.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or `camera` is not a Camera.
    ValueError
        If a shape does not match, `angles` and `pivot` are not given together, or a number is not
        finite.

    Examples
    --------
    >>> import cvkern
    >>> camera = cvkern.Camera([[100, 0, 1], [0, 100, 0], [0, 0, 1]], shape=(9, 3))
    >>> cvkern.triangulate_lines([2.0, 2.0, 4.0], camera, (0, 1, 0, 0.5))[:, 2]
    array([25. , 25. , 12.5], dtype=float32)
    """
    positions = check_image(positions, ndim=(1, 2), name="positions")
    camera = check_lens(camera)
    axis = check_integer(axis, "axis", 0, 1)
    flat = check_matrix(plane, (4,), "plane")
    refuse_masks(spindle=spindle)
    if (angles is None) != (pivot is None):
        raise ValueError("angles and pivot must be given together, got one of them")
    shape = tuple(positions.shape)
    if shape[-1] != camera.shape[1 - axis]:
        raise ValueError(
            f"positions must have {camera.shape[1 - axis]} lines for axis {axis}, got {shape[-1]}"
        )
    rt = runtime(positions)
    places = on_host(rt, positions).reshape(-1, shape[-1])
    lines = np.broadcast_to(np.arange(shape[-1], dtype=np.float64), places.shape)
    seen = (lines, places) if axis == 0 else (places, lines)
    rays = rays_of(np.stack([a.ravel() for a in seen], axis=1), camera)
    with np.errstate(divide="ignore", invalid="ignore"):
        away = flat[3] / (rays @ flat[:3])
        away = np.where((away > 0) & np.isfinite(away), away, np.nan)
    points = (rays * away[:, None]).reshape(*places.shape, 3)
    if angles is not None:
        turns = as_numbers(angles, "angles").ravel()
        if len(turns) != len(points):
            raise ValueError(f"angles must be of {len(points)} frames, got {len(turns)}")
        if not (np.abs(turns) <= FLOAT32_MAX).all():
            raise ValueError("angles must be finite in float32, got some that are not")
        center, along = _three(pivot, "pivot"), _three(spindle, "spindle")
        if not along.any():
            raise ValueError("spindle must be a direction, got zeros")
        along = along / np.abs(along).max()
        along = along / np.linalg.norm(along)
        back = np.stack([turned(-angle * along) for angle in turns])
        points = np.einsum("nij,nlj->nli", back, points - center) + center
    return rt.give(points.reshape(*shape, 3).astype(np.float32))


def _three(values: Any, name: str) -> np.ndarray:
    """Return three finite numbers, or refuse them."""
    numbers = as_numbers(values, name)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise ValueError(f"{name} must be 3 finite numbers, got {values!r}")
    return numbers
