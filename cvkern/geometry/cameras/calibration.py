"""Calibration of a camera from photographs of a board."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import as_items, check_choice, check_integer, check_positive, check_rows_columns
from cvkern._runtime import runtime
from cvkern.geometry._points import check_points, on_host, xy
from cvkern.geometry.cameras._adjustment import (
    Adjusted,
    Poses,
    Residuals,
    adjust,
    crossed,
    projected,
)
from cvkern.geometry.cameras._zhang import first_camera, plane_map, plane_pose
from cvkern.geometry.cameras.lens import (
    MOST_SIDE,
    Camera,
    check_lens,
    focal_and_center,
    matrix_of,
    rays_of,
)

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
FLAT = 1e-9  # distance of a point from its plane, over the size of the board


class Calibration(NamedTuple):
    """A camera, and the poses of the boards relative to it."""

    camera: Camera
    """Camera matrix, lens and size of the images."""
    rms: float
    """Root mean square of the distances between seen and projected points, pixels."""
    rotations: np.ndarray
    """World (board) to camera, (V, 3, 3) float64: X = R W + t, the inverse of a camera-to-world
    pose."""
    translations: np.ndarray
    """t of the same, (V, 3) float64, in the unit of the object points."""
    deviations: np.ndarray
    """Standard deviations of fx, fy, cx, cy, k1, k2, p1, p2, k3, (9,) float64; 0 for fixed ones."""
    view_rms: np.ndarray
    """The root mean square of each view, (V,) float64, pixels."""

    @property
    def matrix(self) -> np.ndarray:
        """Camera matrix, (3, 3) float64."""
        return self.camera.matrix

    @property
    def distortion(self) -> np.ndarray:
        """k1, k2, p1, p2, k3, (5,) float64."""
        return self.camera.distortion


def chessboard_points(shape: tuple[int, int], square: float = 1.0) -> np.ndarray:
    """Return the corners of a chessboard in its own coordinates.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of inner corners.
    square : float, default 1.0
        Side of a square, in the unit for translations and depths.

    Returns
    -------
    numpy.ndarray of shape (rows * columns, 3), float64
        (X, Y, Z) in the order of :func:`detect_chessboard`: X along a row, Y down, Z = 0.

    Raises
    ------
    TypeError
        If a number is not one.
    ValueError
        If `shape` is not two integers of at least 2, or `square` is not > 0.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.chessboard_points((2, 2), 25.0)
    array([[ 0.,  0.,  0.],
           [25.,  0.,  0.],
           [ 0., 25.,  0.],
           [25., 25.,  0.]])
    """
    given = as_items(shape, "shape", "rows and columns of corners")
    sides = tuple(check_integer(n, "shape", 2, 1000) for n in given)
    if len(sides) != 2:
        raise ValueError(f"shape must be rows and columns of corners, got {shape!r}")
    square = check_positive(square, "square")
    rows, columns = np.indices(sides).reshape(2, -1)
    return square * np.stack((columns, rows, np.zeros_like(rows)), axis=1)


def calibrate_camera(
    object_points: Any,
    image_points: Sequence[Any],
    shape: tuple[int, int],
    *,
    camera: Camera | None = None,
    fixed: Sequence[str] = (),
) -> Calibration:
    """Calibrate a camera from several views of a board.

    Parameters
    ----------
    object_points : array of shape (N, 3), or a sequence of V such arrays
        Points of the board in its own coordinates, for example from :func:`chessboard_points`. They
        lie in one plane. A single array is used for all views.
    image_points : sequence of V arrays of shape (N, 2)
        Row and column of these points in each view, for example from :func:`detect_chessboard`.
    shape : (int, int)
        Rows and columns of the images.
    camera : Camera, optional
        Initial camera. By default from Z. Zhang's closed form, without lens distortion.
    fixed : sequence of str, default ()
        Parameters that keep their initial value: any of 'fx', 'fy', 'cx', 'cy', 'k1', 'k2', 'p1',
        'p2', 'k3'. Without `camera`, a fixed lens term is 0, and a fixed principal point is the
        middle of the image.

    Returns
    -------
    Calibration
        Named tuple of `camera`, `rms`, `rotations`, `translations`, `deviations` and `view_rms`;
        `matrix` and `distortion` are those of the camera.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or `camera` is not a Camera.
    ValueError
        If shapes do not match, points are not finite, a board is not flat or has fewer than four
        points, `fixed` has an unknown name, or the points do not determine the free parameters.

    See Also
    --------
    calibrate_stereo : Calibrate two cameras.
    detect_chessboard : Find the points of a view.

    Notes
    -----
    The result is a local minimum of the sum of squared distances between seen and projected points:
    the camera of ``cv2.calibrateCamera``. Standard deviations assume normal noise of the size of
    the residuals. Three or more views with different tilts determine all nine parameters. The lens
    is known only as far out as the points reach.

    References
    ----------
    .. [1] Z. Zhang, "A flexible new technique for camera calibration", IEEE PAMI 22(11), 2000.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> board = cvkern.chessboard_points((4, 5))
    >>> camera = cvkern.Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], [-0.1], (480, 640))
    >>> turns = [(0.5, 0, 0), (0, 0.5, 0), (-0.3, -0.4, 0.2), (0.2, 0.6, 0)]
    >>> views = [cvkern.project_points(board, camera, turn, (-2, -1.5, 9)) for turn in turns]
    >>> found = cvkern.calibrate_camera(board, views, (480, 640))
    >>> found.matrix.round(3) + 0
    array([[500.,   0., 320.],
           [  0., 500., 240.],
           [  0.,   0.,   1.]])
    """
    shape = check_shape(shape)
    boards, places = check_views(object_points, image_points, "image_points")
    free = free_of(fixed)
    check_enough(boards, free, "image_points")
    if camera is not None:
        check_lens(camera)
    numbers, poses = begun(boards, places, shape, camera, "camera")
    if camera is None and not free[2:4].all():  # the middle of the image
        middle = (shape[1] - 1) / 2, (shape[0] - 1) / 2
        numbers[2:4] = np.where(free[2:4], numbers[2:4], middle)
    found = adjusted_camera(boards, places, numbers, poses, free, "image_points")
    off = found.residuals.off
    return Calibration(
        camera_of(found.shared, shape, "image_points"), rms_of(off), *found.poses, found.deviations,
        np.array([rms_of(part) for part in split(off, boards)]),
    )  # fmt: skip


def begun(
    boards: list[np.ndarray], places: list[np.ndarray], shape: tuple[int, int], camera: Any,
    name: str,
) -> tuple[np.ndarray, Poses]:  # fmt: skip
    """Return the initial nine numbers of a camera, the argument `name`, and poses of boards."""
    if camera is None:
        maps = [plane_map(b[:, :2], p) for b, p in zip(boards, places, strict=True)]
        matrix = first_camera(maps, shape)
        numbers = np.array([*focal_and_center(matrix), 0, 0, 0, 0, 0])
    else:
        numbers = numbers_of(camera)
        rays = [rays_of(p, camera)[:, :2] for p in places]
        if not all(np.isfinite(r).all() for r in rays):
            raise ValueError(f"{name} must see all points, got a lens that turns back before some")
        maps = [plane_map(b[:, :2], r) for b, r in zip(boards, rays, strict=True)]
        matrix = np.eye(3)
    poses = [plane_pose(h, matrix) for h in maps]
    return numbers, Poses(np.stack([r for r, _ in poses]), np.stack([t for _, t in poses]))


def adjusted_camera(
    boards: list[np.ndarray], places: list[np.ndarray], numbers: np.ndarray, poses: Poses,
    free: np.ndarray, name: str,
) -> Adjusted:  # fmt: skip
    """Minimise the squared distances between projected and seen points, the argument `name`."""
    views = np.repeat(np.arange(len(boards)), [len(b) for b in boards])
    world, seen = np.concatenate(boards), np.concatenate(places)

    def evaluate(numbers: np.ndarray, poses: Poses) -> Residuals:
        turned = np.einsum("mij,mj->mi", poses.rotations[views], world)
        shown = projected(turned + poses.translations[views], numbers)
        by_pose = np.concatenate((shown.by_point @ crossed(turned), shown.by_point), axis=2)
        return Residuals(shown.places - seen, shown.by_camera, by_pose)

    with seen_by_cameras(name):
        return adjust(evaluate, np.add, numbers, poses, views, free)


@contextmanager
def seen_by_cameras(name: str) -> Iterator[None]:
    """Refuse points, the argument `name`, for which equations have no finite solution."""
    try:
        yield
    except np.linalg.LinAlgError:
        raise ValueError(f"{name} must be of boards that a camera can see, got others") from None


def check_views(
    object_points: Any, image_points: Any, name: str
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the boards (N, 3) and image points (N, 2), x and y, of each view."""
    views = as_items(image_points, name, "a sequence of arrays")
    if not views:
        raise ValueError(f"{name} must have one view at least, got none")
    missing = [n for n, view in enumerate(views) if view is None]
    if missing:
        raise ValueError(f"{name} must have points in each view, got None for view {missing[0]}")
    if not hasattr(object_points, "shape"):
        object_points = as_items(object_points, "object_points", "an array or several")
        several = len(object_points) > 0 and np.ndim(object_points[0]) == 2
    else:
        several = getattr(object_points, "ndim", 2) == 3
    boards = list(object_points) if several else [object_points] * len(views)
    if len(boards) != len(views):
        raise ValueError(
            f"object_points must be of as many views as {name}, {len(views)}, got {len(boards)}"
        )
    worlds, places = [], []
    for n, (board, view) in enumerate(zip(boards, views, strict=True)):
        world = host_points(board, f"object_points[{n}]" if several else "object_points", 3)
        seen = host_points(view, f"{name}[{n}]", 2)
        if len(world) != len(seen):
            raise ValueError(
                f"{name}[{n}] must have as many points as the board, {len(world)}, got {len(seen)}"
            )
        if len(world) < 4:
            raise ValueError(f"{name}[{n}] must have 4 points at least, got {len(world)}")
        if np.abs(world[:, 2]).max() > FLAT * np.abs(world).max():
            raise ValueError(f"object_points must have Z = 0, got {np.abs(world[:, 2]).max():g}")
        worlds.append(world)
        places.append(xy(seen))
    return worlds, places


def host_points(points: Any, name: str, columns: int) -> np.ndarray:
    """Return points of so many columns on the host; refuse those that are not finite."""
    points = check_points(points, name, columns)
    values = on_host(runtime(points), points)
    if not np.isfinite(values).all():
        raise ValueError(f"{name} must be finite, got some that are not")
    return values


def check_shape(shape: Any) -> tuple[int, int]:
    """Return rows and columns of images."""
    rows, columns = check_rows_columns(shape, "images")
    return check_integer(rows, "shape", 1, MOST_SIDE), check_integer(columns, "shape", 1, MOST_SIDE)


def free_of(fixed: Sequence[str]) -> np.ndarray:
    """Return which of the nine camera numbers are free."""
    rule = "a sequence of names of parameters"
    names = (fixed,) if isinstance(fixed, str) else as_items(fixed, "fixed", rule)
    for name in names:
        check_choice(name, PARAMETERS, "fixed")
    return np.array([name not in names for name in PARAMETERS])


def check_enough(boards: list[np.ndarray], free: np.ndarray, name: str) -> None:
    """Refuse too few views: a plane determines two camera numbers in addition to its pose."""
    matrix = int(free[:4].sum())
    if 2 * len(boards) < matrix:
        raise ValueError(
            f"{name} must be of {-(-matrix // 2)} views at least to tell {matrix} numbers of "
            f"a camera matrix, got {len(boards)}: more views, or more in fixed"
        )
    points = sum(len(board) for board in boards)
    unknowns = int(free.sum()) + 6 * len(boards)
    if 2 * points < unknowns:
        raise ValueError(
            f"{name} must be {-(-unknowns // 2)} points at least to tell {unknowns} "
            f"numbers, got {points}"
        )


def numbers_of(camera: Camera) -> np.ndarray:
    """Return fx, fy, cx, cy, k1, k2, p1, p2, k3."""
    return np.concatenate((focal_and_center(camera.matrix), camera.distortion))


def camera_of(numbers: np.ndarray, shape: tuple[int, int], name: str) -> Camera:
    """Return the camera of nine numbers, which were found from the argument `name`."""
    try:
        return Camera(matrix_of(*numbers[:4]), numbers[4:], shape)
    except ValueError as error:
        raise ValueError(f"{name} must be of boards that a camera can see: {error}") from None


def split(values: np.ndarray, boards: list[np.ndarray]) -> list[np.ndarray]:
    """Split values into those of each view."""
    return np.split(values, np.cumsum([len(b) for b in boards])[:-1])


def rms_of(off: np.ndarray) -> float:
    """Return the root mean square of distances (M, 2)."""
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
