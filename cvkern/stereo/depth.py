"""Metric depth, points and coloured clouds from disparities."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import (
    MAX_ELEMENTS,
    as_array,
    check_dtype,
    check_image,
    check_number,
    check_positive,
)
from cvkern._runtime import runtime

PART = 64  # pixels of a row whose points one thread collects


class PointCloud(NamedTuple):
    """Points and their colours, in the order of the pixels."""

    points: Any
    """(x, y, z), (N, 3) float32, in the units of the baseline."""
    colors: Any
    """Red, green, blue, (N, 3) uint8."""


def disparity_to_depth(disparity: Any, focal: float, baseline: float, doffs: float = 0.0) -> Any:
    """Compute depth from disparities: ``focal * baseline / (disparity + doffs)``.

    Parameters
    ----------
    disparity : array of shape (H, W)
        Pixels; any real dtype. Not finite where the disparity is unknown.
    focal : float
        Focal length of the rectified cameras, pixels, > 0.
    baseline : float
        Distance between the two cameras, > 0; the depth has its units.
    doffs : float, default 0.0
        Column of the right camera's principal point minus that of the left camera's, pixels (as in
        Middlebury's ``calib.txt``).

    Returns
    -------
    array of shape (H, W), float32
        Distance along the optical axis. It is infinite where ``disparity + doffs`` is 0. It is NaN
        where this sum is negative, because no point in front of the cameras has such a disparity,
        and where the disparity is not finite.

    Raises
    ------
    TypeError
        If `disparity` does not hold real numbers.
    ValueError
        If `disparity` is empty or not 2-D, `focal` or `baseline` is not positive, or a number is
        not finite in float32.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.disparity_to_depth([[25.0, 50.0, 0.0, -1.0]], focal=1000, baseline=0.1)
    array([[ 4.,  2., inf, nan]], dtype=float32)
    """
    disparity = check_image(disparity, name="disparity")
    scale = check_number(
        check_positive(focal, "focal") * check_positive(baseline, "baseline"),
        "focal times baseline",
    )
    doffs = check_number(doffs, "doffs")
    rt = runtime(disparity)
    depth = rt.empty(tuple(disparity.shape))
    rt.stereo.depth.depth(rt.adopt(disparity), scale, doffs, rt.adopt(depth))
    return rt.release(depth)


def reprojection_matrix(
    focal: float, baseline: float, cx: float, cy: float, doffs: float = 0.0
) -> np.ndarray:
    """Return OpenCV's matrix Q, which maps (x, y, disparity, 1) to a point.

    Parameters
    ----------
    focal, baseline, doffs : float
        As in :func:`disparity_to_depth`.
    cx, cy : float
        Principal point of the left camera: its column and its row, pixels.

    Returns
    -------
    array of shape (4, 4), float64
        For :func:`points_from_disparity` and for ``cv2.reprojectImageTo3D``.

    Raises
    ------
    ValueError
        If `focal` or `baseline` is not positive, or a number is not finite in float32.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.reprojection_matrix(1000, 0.5, 320, 240)
    array([[   1.,    0.,    0., -320.],
           [   0.,    1.,    0., -240.],
           [   0.,    0.,    0., 1000.],
           [   0.,    0.,    2.,    0.]])
    """
    focal, baseline = check_positive(focal, "focal"), check_positive(baseline, "baseline")
    cx, cy, doffs = check_number(cx, "cx"), check_number(cy, "cy"), check_number(doffs, "doffs")
    q = np.eye(4)
    q[0, 3], q[1, 3] = -cx, -cy
    q[2, 2:] = 0.0, focal
    q[3, 2:] = 1.0 / baseline, doffs / baseline
    return q + 0.0  # no -0


def points_from_disparity(disparity: Any, q: Any) -> Any:
    """Compute the point in space of each pixel and its disparity.

    Parameters
    ----------
    disparity : array of shape (H, W)
        Pixels; any real dtype. Not finite where the disparity is unknown.
    q : array-like of shape (4, 4)
        Matrix that maps (x, y, disparity, 1) to a point in homogeneous coordinates, from
        :func:`reprojection_matrix` or ``cv2.stereoRectify``. It must be on the host.

    Returns
    -------
    array of shape (H, W, 3), float32
        (x, y, z): right, down and forward from the left camera, in the units of the baseline.
        NaN where the disparity is not finite, or the point is not (its homogeneous coordinate is
        0).

    Raises
    ------
    TypeError
        If `disparity` does not hold real numbers.
    ValueError
        If `disparity` is empty, not 2-D or too large, or `q` is not a 4 x 4 matrix of numbers that
        are finite in float32.

    Notes
    -----
    The result is that of ``cv2.reprojectImageTo3D``, computed in float32.

    Examples
    --------
    >>> import cvkern
    >>> q = cvkern.reprojection_matrix(focal=100, baseline=1, cx=1, cy=0)
    >>> cvkern.points_from_disparity([[25.0, 25.0, 50.0]], q)
    array([[[-0.04,  0.  ,  4.  ],
            [ 0.  ,  0.  ,  4.  ],
            [ 0.02,  0.  ,  2.  ]]], dtype=float32)
    """
    disparity = _check_disparity(disparity)
    matrix = _matrix(q)
    rt = runtime(disparity)
    points = rt.empty((*disparity.shape, 3))
    rt.stereo.depth.points(rt.adopt(disparity), rt.constant(matrix), rt.adopt(points))
    return rt.release(points)


def point_cloud(disparity: Any, q: Any, image: Any, valid: Any = None) -> PointCloud:
    """Collect the points of a disparity map, with the colours of their pixels.

    Parameters
    ----------
    disparity, q
        As in :func:`points_from_disparity`.
    image : array of shape (H, W) or (H, W, 3), uint8
        The left image: grey, or red, green, blue.
    valid : array of shape (H, W), bool, optional
        Pixels to use. Pixels without a finite point are always left out.

    Returns
    -------
    PointCloud
        Named tuple of `points` (N, 3), float32, and `colors` (N, 3), uint8.

    Raises
    ------
    TypeError
        If `disparity` does not hold real numbers, `image` is not uint8 or `valid` not bool.
    ValueError
        As :func:`points_from_disparity`, or if the shapes do not agree.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> q = cvkern.reprojection_matrix(focal=1000, baseline=0.1, cx=1, cy=0)
    >>> gray = np.array([[10, 20, 30]], np.uint8)
    >>> cvkern.point_cloud([[25.0, np.nan, 50.0]], q, gray).colors
    array([[10, 10, 10],
           [30, 30, 30]], dtype=uint8)
    """
    disparity = _check_disparity(disparity)
    image = check_image(image, ndim=(2, 3))
    matrix, shape = _matrix(q), tuple(disparity.shape)
    if tuple(image.shape) not in (shape, (*shape, 3)):
        raise ValueError(
            f"image must have shape {shape} or {(*shape, 3)}, as the disparity, "
            f"got {tuple(image.shape)}"
        )
    check_dtype(image, np.uint8, "image")
    if valid is not None:
        valid = check_image(valid, name="valid")
        if tuple(valid.shape) != shape:
            raise ValueError(
                f"valid must have shape {shape}, as the disparity, got {tuple(valid.shape)}"
            )
        check_dtype(valid, np.bool_, "valid")
    rt = runtime(disparity, image, valid)
    points = rt.scratch("cloud.points", (*shape, 3))
    rt.stereo.depth.points(rt.adopt(disparity), rt.constant(matrix), points)
    mask = rt.constant(np.ones((1, 1), np.uint8)) if valid is None else rt.adopt(valid, bool)
    parts = shape[0], -(-shape[1] // PART)
    counts = rt.scratch("cloud.counts", parts, np.int32)
    rt.stereo.depth.count_points(points, mask, counts)
    ends = np.cumsum(rt.to_numpy(counts), dtype=np.int32)
    starts = np.concatenate(([0], ends[:-1]), dtype=np.int32).reshape(parts)
    total = int(ends[-1])
    cloud = PointCloud(rt.empty((total, 3)), rt.empty((total, 3), np.uint8))
    if total:
        channels = rt.adopt(image, np.uint8, (*shape, 1) if len(image.shape) == 2 else None)
        views = rt.adopt(cloud.points), rt.adopt(cloud.colors, np.uint8)
        rt.stereo.depth.gather_points(points, mask, channels, rt.adopt(starts, np.int32), *views)
    return PointCloud(*(rt.release(a) for a in cloud))


def _check_disparity(disparity: Any) -> Any:
    """Return a disparity map small enough for kernels to index three numbers per pixel."""
    disparity = check_image(disparity, name="disparity")
    if 3 * math.prod(disparity.shape) > MAX_ELEMENTS:
        raise ValueError(
            f"disparity must have at most {MAX_ELEMENTS // 3} elements, "
            f"got shape {tuple(disparity.shape)}"
        )
    return disparity


def _matrix(q: Any) -> np.ndarray:
    matrix = np.asarray(as_array(q, "q"))
    if matrix.shape != (4, 4) or matrix.dtype.kind not in "iuf":
        raise ValueError(
            f"q must be a 4 x 4 matrix of numbers, got {matrix.dtype} of shape {matrix.shape}"
        )
    with np.errstate(over="ignore"):
        matrix = matrix.astype(np.float32)
    if not np.isfinite(matrix).all():
        raise ValueError(f"q must be finite, got {matrix[~np.isfinite(matrix)][0]}")
    return matrix
