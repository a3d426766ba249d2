"""The camera model: a pinhole with lens distortion, in the conventions of OpenCV.

Camera axes are x right, y down, z forward. The centre of the pixel in row i and column j has the
image coordinates (x, y) = (j, i), here and in every kernel. A pose is a pair (rotation,
translation) that maps a point W of the world to camera axes, X = R W + t.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cvkern._checks import FLOAT32_MAX, as_items, as_numbers, check_integer
from cvkern._runtime import runtime
from cvkern.geometry._matrices import check_matrix
from cvkern.geometry._points import check_points, on_host, xy

# Newton's method doubles the correct digits in each step; lenses need three or four steps.
_NEWTON_STEPS = 10
_WIDEST = 1e6  # largest tangent of the angle between a ray and the optical axis
# Largest residual of a converged point, in units of the focal length.
_MET = 1e-9
UNKNOWN = 1, 1  # shape of images that is not told
MOST_SIDE = 2**16  # pixels along a side of an image
SKEWED = 1e-9  # least skew that is refused, as a share of the focal length


@dataclass(frozen=True, eq=False)
class Camera:
    """Map from directions to pixels: focal lengths, principal point, lens distortion.

    Parameters
    ----------
    matrix : array of shape (3, 3)
        Camera matrix, ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`` in pixels.
    distortion : sequence of 0 to 5 numbers, default ()
        k1, k2, p1, p2, k3 of OpenCV's lens model; missing ones are 0.
    shape : (int, int), default (1, 1)
        Rows and columns of the images; (1, 1) if they are not known, and not needed.

    Raises
    ------
    TypeError
        If a number is not real.
    ValueError
        If a shape does not match, a number is not finite, a focal length is not positive, or the
        matrix has a skew.

    Notes
    -----
    With x and y over z, and ``r^2 = x^2 + y^2``, the lens moves a point to
    ``x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)`` and, for y,
    ``y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y``.

    Examples
    --------
    >>> import cvkern
    >>> camera = cvkern.Camera([[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]], [-0.2], (480, 640))
    >>> camera.distortion
    array([-0.2,  0. ,  0. ,  0. ,  0. ])
    """

    matrix: Any
    """Camera matrix, (3, 3) float64: it acts on (x, y, 1), x the column, y the row."""
    distortion: Any = ()
    """k1, k2, p1, p2, k3 of OpenCV's lens, (5,) float64."""
    shape: tuple[int, int] = UNKNOWN
    """Rows and columns of the images."""

    def __post_init__(self) -> None:
        matrix = check_matrix(self.matrix, (3, 3), "matrix")
        fx, fy = matrix[0, 0], matrix[1, 1]
        if not (fx > 0 and fy > 0):
            raise ValueError(f"matrix must have fx, fy > 0, got {fx:g} and {fy:g}")
        rest = [matrix[0, 1], matrix[1, 0], *matrix[2, :2], matrix[2, 2] - 1]
        if max(map(abs, rest)) > SKEWED * max(fx, fy):
            raise ValueError(
                "matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "
                f"got {matrix.round(6).tolist()}"
            )
        given = as_items(self.shape, "shape", "rows and columns")
        sides = tuple(check_integer(n, "shape", 1, MOST_SIDE) for n in given)
        if len(sides) != 2:
            raise ValueError(f"shape must be rows and columns, got {len(sides)} numbers")
        object.__setattr__(self, "matrix", matrix.copy())
        object.__setattr__(self, "distortion", check_distortion(self.distortion))
        object.__setattr__(self, "shape", sides)

    def __repr__(self) -> str:
        fx, fy, cx, cy = (f"{n:.6g}" for n in focal_and_center(self.matrix))
        lens = ", ".join(f"{k:.4g}" for k in self.distortion)
        return f"Camera(fx={fx}, fy={fy}, cx={cx}, cy={cy}, distortion=[{lens}], {self.shape})"


def check_distortion(distortion: Any) -> np.ndarray:
    """Return five finite numbers: k1, k2, p1, p2, k3."""
    given = as_numbers(distortion, "distortion").ravel()
    if len(given) > 5:
        if np.any(given[5:]):
            raise ValueError(
                "distortion must be k1, k2, p1, p2, k3 of OpenCV's lens, "
                f"got {len(given)} numbers, {np.count_nonzero(given[5:])} more of them not 0"
            )
        given = given[:5]
    if not np.isfinite(given).all():
        raise ValueError(f"distortion must be finite, got {given.tolist()}")
    return np.concatenate((given, np.zeros(5 - len(given))))


def check_lens(camera: Any, name: str = "camera") -> Camera:
    """Return a camera, and refuse anything else."""
    if not isinstance(camera, Camera):
        raise TypeError(f"{name} must be a Camera, got {type(camera).__name__}")
    return camera


def matrix_of(fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    """Return the camera matrix of its four numbers."""
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def focal_and_center(matrix: np.ndarray) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy of a camera matrix."""
    return matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]


def project_points(
    points: Any, camera: Camera, rotation: Any = None, translation: Any = None
) -> Any:
    """Project points in space to the image of a camera.

    Parameters
    ----------
    points : array of shape (N, 3)
        Points of the world, in any unit of length.
    camera : Camera
        The camera and its lens.
    rotation : array of shape (3, 3) or (3,), optional
        World to camera, X = R W + t: the inverse of a camera-to-world pose. A vector of three is a
        rotation about itself by its length in radians. By default the identity.
    translation : array of shape (3,), optional
        The t of this pose. By default 0.

    Returns
    -------
    array of shape (N, 2), float64
        Row and column, also beyond the image; NaN for points that are not in front of the camera.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or `camera` is not a Camera.
    ValueError
        If a shape does not match, or a pose is not finite or not a rotation.

    See Also
    --------
    undistort_points : Remove lens distortion from points of an image.

    Notes
    -----
    Equal to ``cv2.projectPoints``, except that points behind the camera are NaN.

    Examples
    --------
    >>> import cvkern
    >>> camera = cvkern.Camera([[100, 0, 50], [0, 100, 40], [0, 0, 1]], shape=(80, 100))
    >>> cvkern.project_points([[0, 0, 1], [0.5, 0.25, 2], [0, 0, -1]], camera)
    array([[40. , 50. ],
           [52.5, 75. ],
           [ nan,  nan]])
    """
    camera = check_lens(camera)
    points = check_points(points, "points", 3)
    rt = runtime(points)
    turn, shift = check_pose(rotation, translation)
    return rt.give(np.ascontiguousarray(xy(seen(on_host(rt, points), camera, turn, shift))))


def seen(points: np.ndarray, camera: Camera, turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Return (x, y) at which a camera sees points of the world; NaN for those behind it."""
    with np.errstate(invalid="ignore", over="ignore"):  # points may not be finite
        inside = points @ turn.T + shift
    depth = np.where(inside[:, 2:] > 0, inside[:, 2:], np.nan)
    fx, fy, cx, cy = focal_and_center(camera.matrix)
    return bent(inside[:, :2] / depth, camera.distortion) * (fx, fy) + (cx, cy)


def undistort_points(points: Any, camera: Camera, matrix: Any = None, rotation: Any = None) -> Any:
    """Remove lens distortion from points of an image.

    Parameters
    ----------
    points : array of shape (N, 2)
        Row and column in images of `camera`; fractions are allowed.
    camera : Camera
        The camera of the image.
    matrix : array of shape (3, 3), optional
        Matrix of the ideal camera without distortion, or the first three columns of a projection.
        By default the matrix of `camera`.
    rotation : array of shape (3, 3) or (3,), optional
        Rotation of the rays before that, X' = R X, as for rectified images.

    Returns
    -------
    array of shape (N, 2), float64
        Row and column. NaN where no ray exists: beyond the radius at which the lens polynomial
        stops increasing, and where a ray is not in front of the rotated camera.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or `camera` is not a Camera.
    ValueError
        If a shape does not match, or a matrix is not finite.

    See Also
    --------
    project_points : The inverse.

    Notes
    -----
    Equal to ``cv2.undistortPointsIter`` with many iterations; solved by Newton's method.

    Examples
    --------
    >>> import cvkern
    >>> camera = cvkern.Camera([[100, 0, 50], [0, 100, 40], [0, 0, 1]], [-0.1], (80, 100))
    >>> cvkern.undistort_points([[40, 50], [70, 10]], camera).round(2)
    array([[40.  , 50.  ],
           [70.81,  8.92]])
    """
    camera = check_lens(camera)
    points = check_points(points, "points")
    rt = runtime(points)
    flat = camera.matrix if matrix is None else check_matrix(matrix, (3, 3), "matrix")
    turn = check_pose(rotation, None)[0]
    rays = rays_of(xy(on_host(rt, points)), camera)
    rays = rays @ turn.T @ flat.T
    with np.errstate(invalid="ignore", divide="ignore"):
        places = np.where(rays[:, 2:] > 0, rays[:, :2] / rays[:, 2:], np.nan)
    return rt.give(xy(places))


def rays_of(places: np.ndarray, camera: Camera) -> np.ndarray:
    """Return the rays (x, y, 1) of points (x, y) of an image; NaN where there is none."""
    fx, fy, cx, cy = focal_and_center(camera.matrix)
    found = (places - (cx, cy)) / (fx, fy)
    lens = camera.distortion
    if np.any(lens):
        wanted, found = found, straightened(found, lens)
        off = np.abs(bent(found, lens) - wanted).max(axis=1)
        known = (off < _MET * (1 + np.abs(wanted).max(axis=1))) & (
            (found**2).sum(axis=1) < turning_radius(lens) ** 2
        )
        found = np.where(known[:, None], found, np.nan)
    return np.concatenate((found, np.ones((len(found), 1))), axis=1)


def turning_radius(distortion: np.ndarray) -> float:
    """Return the least radius at which the radial polynomial stops increasing, or infinity."""
    k1, k2, _, _, k3 = distortion
    roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0]) if np.any((k1, k2, k3)) else np.zeros(0)
    real = roots.real[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)]
    return math.sqrt(real.min()) if len(real) else math.inf


def check_pose(rotation: Any, translation: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return a rotation (3, 3) and a translation (3,); None gives the identity and 0."""
    if rotation is None:
        turn = np.eye(3)
    else:
        turn = np.squeeze(as_numbers(rotation, "rotation"))
        if not (np.abs(turn) <= FLOAT32_MAX).all():
            raise ValueError(f"rotation must be finite, got {turn.tolist()}")
        if turn.shape == (3,):
            turn = turned(turn)
        if turn.shape != (3, 3):
            raise ValueError(f"rotation must have shape (3, 3) or (3,), got {turn.shape}")
        off = np.abs(turn @ turn.T - np.eye(3)).max()
        if not off < 1e-3 or np.linalg.det(turn) < 0:
            raise ValueError(f"rotation must be a rotation, got {turn.round(6).tolist()}")
    shift = np.zeros(3) if translation is None else as_numbers(translation, "translation").ravel()
    if shift.shape != (3,):
        raise ValueError(f"translation must have shape (3,), got {shift.shape}")
    if not np.isfinite(shift).all():
        raise ValueError(f"translation must be finite, got {shift.tolist()}")
    return turn, shift


def turned(vector: np.ndarray) -> np.ndarray:
    """Return the rotation about a vector by its length in radians [Rodrigues]."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    if angle < 1e-8:
        return np.eye(3) + cross + cross @ cross / 2
    return (
        np.eye(3)
        + math.sin(angle) / angle * cross
        + (1 - math.cos(angle)) / angle**2 * (cross @ cross)
    )


def turn_of(rotation: np.ndarray) -> np.ndarray:
    """Return the rotation vector of a rotation, the inverse of `turned`."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_rotvec()


def bent(points: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """Distort normalised image points (N, 2), x and y, as a lens does [OpenCV, calib3d]."""
    k1, k2, p1, p2, k3 = distortion
    x, y = points[:, 0], points[:, 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        (
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ),
        axis=1,
    )


def slopes(
    x: np.ndarray, y: np.ndarray, distortion: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the derivatives of :func:`bent`, which are symmetric: xx, xy and yy."""
    k1, k2, p1, p2, k3 = distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + 3 * k3 * r2))  # d radial / d x = slope x
    xx = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
    xy = slope * x * y + 2 * p1 * x + 2 * p2 * y
    yy = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
    return xx, xy, yy


@np.errstate(all="ignore")  # results of a slope of 0 are checked at the end
def straightened(points: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """Undo :func:`bent` by Newton's method.

    If there is no solution, the result is arbitrary, but never so far away that a ray would have no
    direction.
    """
    if not np.any(distortion):
        return points
    found = points.copy()
    for _ in range(_NEWTON_STEPS):
        off = bent(found, distortion) - points
        xx, xy, yy = slopes(found[:, 0], found[:, 1], distortion)
        det = xx * yy - xy * xy
        step = np.stack((yy * off[:, 0] - xy * off[:, 1], xx * off[:, 1] - xy * off[:, 0]), axis=1)
        found -= step / det[:, None]
    astray = ~(np.abs(found) < _WIDEST).all(axis=1)
    found[astray] = points[astray]
    return found
