"""Rectification: pairs of images whose rows correspond."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_choice, check_image, check_number
from cvkern.geometry.cameras.lens import (
    Camera,
    check_lens,
    rays_of,
    turn_of,
    turned,
    undistort_points,
)
from cvkern.geometry.cameras.stereo_calibration import StereoCalibration, check_stereo
from cvkern.geometry.cameras.undistortion import sampled, undistort, undistortion_numbers

KEPT = ("scale", "valid", "all")
STEEPEST = 0.5  # largest share of the baseline across the rows
BORDER = 33  # points along a side that trace the outline of an image


class RectifiedPair(NamedTuple):
    """Two images in which a point lies in the same row."""

    left: Any
    """The first image, (H, W) or (H, W, C), in the library and on the device of the input."""
    right: Any
    """The second image, likewise."""


class Rectification(NamedTuple):
    """The map from the images of two cameras to those of two parallel cameras side by side.

    Call it with a pair of images.
    """

    left: Camera
    """The first camera, as it is."""
    right: Camera
    """The second camera."""
    rotations: np.ndarray
    """From the rays of each camera to those of the rectified one, (2, 3, 3) float64."""
    matrix: np.ndarray
    """Camera matrix of both rectified images, (3, 3) float64."""
    baseline: float
    """Distance of the cameras, in the unit of the calibration."""

    @property
    def focal(self) -> float:
        """Focal length of the rectified images, pixels."""
        return float(self.matrix[0, 0])

    @property
    def reprojection(self) -> np.ndarray:
        """The matrix of :func:`cvkern.reprojection_matrix`, (4, 4) float64."""
        fx, cx, cy = self.matrix[0, 0], self.matrix[0, 2], self.matrix[1, 2]
        rows = [[1, 0, 0, -cx], [0, 1, 0, -cy], [0, 0, 0, fx], [0, 0, 1 / self.baseline, 0]]
        return np.array(rows)

    def points(self, left: Any, right: Any) -> tuple[Any, Any]:
        """Map points (row, column) of both images to the rectified images, float64."""
        one, other = (
            undistort_points(points, camera, self.matrix, turn)
            for points, camera, turn in zip(
                (left, right), (self.left, self.right), self.rotations, strict=True
            )
        )
        return one, other

    def __call__(self, left: Any, right: Any, *, cval: float = 0.0) -> RectifiedPair:
        """Rectify a pair of images, each in one kernel.

        Parameters
        ----------
        left, right : array of shape (H, W) or (H, W, C)
            Images of the two cameras, as in :func:`undistort`.
        cval : float, default 0.0
            Value of pixels that a camera did not see.

        Returns
        -------
        RectifiedPair
            Named tuple of `left` and `right`, of the shape of the images.

        Raises
        ------
        TypeError, ValueError
            As :func:`undistort`.
        """
        given = _checked(left, "left", self.left.shape), _checked(right, "right", self.right.shape)
        one, other = (
            undistort(image, camera, self.matrix, turn, cval=cval)
            for image, camera, turn in zip(
                given, (self.left, self.right), self.rotations, strict=True
            )
        )
        return RectifiedPair(one, other)

    def sampler(self) -> _Sampler:
        """Return a callable that rectifies many pairs, with all parameters computed once."""
        numbers = (
            undistortion_numbers(camera, self.matrix, turn, self.left.shape)
            for camera, turn in zip((self.left, self.right), self.rotations, strict=True)
        )
        return _Sampler(self.left.shape, *numbers)


class _Sampler(NamedTuple):
    """The parameters of the kernels for both images."""

    shape: tuple[int, int]
    left: np.ndarray
    right: np.ndarray

    def __call__(self, left: Any, right: Any) -> RectifiedPair:
        """Rectify checked images."""
        pair = []
        for name, image, numbers in (("left", left, self.left), ("right", right, self.right)):
            pair.append(sampled(_checked(image, name, self.shape), numbers, self.shape, 0.0))
        return RectifiedPair(*pair)


def _checked(image: Any, name: str, shape: tuple[int, int]) -> Any:
    """Return an image of a camera as an array."""
    image = check_image(image, ndim=(2, 3), name=name)
    if tuple(image.shape[:2]) != shape:
        raise ValueError(f"{name} must have shape {shape}, got {tuple(image.shape)}")
    return image


def rectify_stereo(
    calibration: StereoCalibration, *, keep: str = "scale", zoom: float = 1.0
) -> Rectification:
    """Compute the rectification of two calibrated cameras.

    Parameters
    ----------
    calibration : StereoCalibration
        Calibration from :func:`calibrate_stereo` or :func:`read_calibration`. The first camera
        stands on the left.
    keep : {'scale', 'valid', 'all'}, default 'scale'
        'scale' keeps the mean focal length, and the middle of both images in the middle. 'valid'
        enlarges until neither image has empty pixels. 'all' shrinks until everything that the
        cameras saw is visible.
    zoom : float, default 1.0
        Factor that multiplies the resulting focal length.

    Returns
    -------
    Rectification
        Named tuple of `left`, `right`, `rotations`, `matrix` and `baseline`, with `focal` and
        `reprojection`. Called with two images it rectifies them; its `points` do so with points.

    Raises
    ------
    TypeError
        If `calibration` is not a StereoCalibration.
    ValueError
        If the second camera does not stand to the right of the first, `keep` is unknown, or `zoom`
        is not > 0.

    See Also
    --------
    stereo_match : Disparities of a rectified pair.

    Notes
    -----
    Each camera is rotated by half of the rotation between them, and then both together until the
    baseline runs along the rows [1]_. Among all rectifications this one distorts the images least.
    Both have the same matrix. Points at infinity therefore have disparity 0, and depth is `focal`
    times `baseline` over the disparity.

    References
    ----------
    .. [1] A. Fusiello, E. Trucco and A. Verri, "A compact algorithm for rectification of stereo
       pairs", Machine Vision and Applications 12, 2000.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> camera = cvkern.Camera([[50, 0, 31.5], [0, 50, 23.5], [0, 0, 1]], shape=(48, 64))
    >>> board = cvkern.chessboard_points((3, 4))
    >>> turns = [(0.5, 0, 0), (0, 0.5, 0), (-0.3, -0.4, 0.2), (0.3, 0.4, 0)]
    >>> left, right = (
    ...     [cvkern.project_points(board, camera, turn, (x, -1, 9)) for turn in turns]
    ...     for x in (-1, -3)
    ... )
    >>> found = cvkern.calibrate_stereo(board, left, right, (48, 64))
    >>> rectified = cvkern.rectify_stereo(found)
    >>> round(rectified.baseline, 3), round(rectified.focal, 2)
    (2.0, 50.0)
    """
    calibration = check_stereo(calibration)
    check_choice(keep, KEPT, "keep")
    zoom = check_number(zoom, "zoom")
    if zoom <= 0:
        raise ValueError(f"zoom must be > 0, got {zoom:g}")
    left, right = check_lens(calibration.left, "left"), check_lens(calibration.right, "right")
    baseline = float(np.linalg.norm(calibration.translation))
    half = turn_of(calibration.rotation) / 2
    way = -turned(-half) @ calibration.translation / baseline  # to the second camera
    if not (way[0] > 0 and np.hypot(way[1], way[2]) < STEEPEST):
        raise ValueError(
            "calibration must have its second camera to the right of the first, got the direction "
            f"{way.round(3).tolist()} (right, down, ahead)"
        )
    across = np.cross(way, (1.0, 0, 0))
    sine = float(np.linalg.norm(across))
    level = turned(across / sine * np.arcsin(sine)) if sine > 1e-12 else np.eye(3)
    turns = np.stack((level @ turned(half), level @ turned(-half)))
    matrix = _matrix((left, right), turns, keep)
    matrix[:2, :2] *= zoom
    middle = np.array([left.shape[1] - 1, left.shape[0] - 1]) / 2
    matrix[:2, 2] = middle + zoom * (matrix[:2, 2] - middle)
    return Rectification(left, right, turns, matrix, baseline)


def _matrix(cameras: tuple[Camera, Camera], turns: np.ndarray, keep: str) -> np.ndarray:
    """Return the camera matrix of the rectified images."""
    height, width = cameras[0].shape
    size = np.array([width - 1, height - 1])
    if keep == "scale":
        focal = float(np.mean([camera.matrix[[0, 1], [0, 1]] for camera in cameras]))
        middles = [_outline(c, turn, size / 2) for c, turn in zip(cameras, turns, strict=True)]
        center = np.concatenate(middles).mean(axis=0)
    else:
        share = np.linspace(0, 1, BORDER)
        ends = {
            "left": np.stack((0 * share, share), 1), "right": np.stack((0 * share + 1, share), 1),
            "top": np.stack((share, 0 * share), 1), "bottom": np.stack((share, 0 * share + 1), 1),
        }  # fmt: skip
        inner = keep == "valid"
        most, least = (np.nanmax, np.nanmin) if inner else (np.nanmin, np.nanmax)
        seen = {
            side: np.concatenate(
                [_outline(c, turn, p * size) for c, turn in zip(cameras, turns, strict=True)]
            )
            for side, p in ends.items()
        }
        low = np.array([most(seen["left"][:, 0]), most(seen["top"][:, 1])])
        high = np.array([least(seen["right"][:, 0]), least(seen["bottom"][:, 1])])
        if not (high > low).all():
            raise ValueError(
                "calibration must have cameras whose images overlap, got none that do for keep="
                f"{keep!r}"
            )
        scales = size / (high - low)
        focal = float(scales.max() if inner else scales.min())
        center = (low + high) / 2
    cx, cy = size / 2 - focal * center
    return np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1.0]])


def _outline(camera: Camera, turn: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return rays of the turned camera to places of its image, x and y; NaN where none is."""
    rays = rays_of(np.atleast_2d(places), camera) @ turn.T
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(rays[:, 2:] > 0, rays[:, :2] / rays[:, 2:], np.nan)
