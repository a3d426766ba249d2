"""Removal of lens distortion from images, with an optional rotation of the camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import as_items, check_image, check_integer, check_number
from cvkern._runtime import runtime
from cvkern.geometry._matrices import check_matrix
from cvkern.geometry.cameras.calibration import numbers_of
from cvkern.geometry.cameras.lens import MOST_SIDE, Camera, check_lens, check_pose, turning_radius


def undistort(
    image: Any,
    camera: Camera,
    matrix: Any = None,
    rotation: Any = None,
    *,
    shape: Sequence[int] | None = None,
    cval: float = 0.0,
) -> Any:
    """Remove lens distortion from an image, and optionally rotate the camera.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C)
        Image of `camera`, of its shape; at least 2 x 2, with at most 4 channels. Any real dtype.
    camera : Camera
        The camera and its lens.
    matrix : array of shape (3, 3), optional
        Camera matrix of the result; the matrix of `camera` by default.
    rotation : array of shape (3, 3) or (3,), optional
        From rays of the camera to rays of the result, X' = R X; the identity by default.
    shape : (int, int), optional
        Rows and columns of the result; the shape of the image by default.
    cval : float, default 0.0
        Value of pixels that the camera did not see.

    Returns
    -------
    array of shape (H', W') or (H', W', C), uint8 or float32
        uint8 if `image` is uint8, else float32. Equal bit for bit on all devices.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers, or `camera` is not a Camera.
    ValueError
        If a shape does not match, or a matrix is not finite and invertible.

    See Also
    --------
    undistort_points : The same for points.
    rectify_stereo : The same for both images of a pair, with corresponding rows.

    Notes
    -----
    The result is that of ``cv2.initUndistortRectifyMap`` and ``cv2.remap`` with linear weights, in
    one kernel and without a map in memory. The weights of bytes are multiples of 1/256.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> camera = cvkern.Camera([[4, 0, 1], [0, 4, 1], [0, 0, 1]], shape=(3, 3))
    >>> ahead = [[4, 0, 0], [0, 4, 1], [0, 0, 1]]  # the principal point one column to the left
    >>> cvkern.undistort([[0, 1, 2], [3, 4, 5], [6, 7, 8]], camera, ahead)
    array([[1., 2., 0.],
           [4., 5., 0.],
           [7., 8., 0.]], dtype=float32)
    """
    image = check_image(image, ndim=(2, 3))
    sides = tuple(image.shape)
    camera = check_lens(camera)
    if sides[:2] != camera.shape:
        raise ValueError(f"image must have the shape of the camera, {camera.shape}, got {sides}")
    if min(sides[:2]) < 2:
        raise ValueError(f"image must have at least 2 rows and 2 columns, got shape {sides}")
    if len(sides) == 3 and sides[2] > 4:
        raise ValueError(f"image must have at most 4 channels, got {sides[2]}")
    numbers = undistortion_numbers(camera, matrix, rotation)
    made = sides[:2] if shape is None else as_items(shape, "shape", "rows and columns")
    if len(made) != 2:
        raise ValueError(f"shape must be rows and columns, got {len(made)} numbers")
    made = tuple(check_integer(n, "shape", 1, MOST_SIDE) for n in made)
    cval = check_number(cval, "cval")
    return sampled(image, numbers, made, cval)


def undistortion_numbers(camera: Camera, matrix: Any, rotation: Any) -> np.ndarray:
    """Return kernel parameters: the matrix from new pixels to old rays, and the old camera."""
    new = camera.matrix if matrix is None else check_matrix(matrix, (3, 3), "matrix")
    if np.linalg.matrix_rank(new) < 3:
        raise ValueError("matrix must have an inverse, got a matrix of rank below 3")
    turn = check_pose(rotation, None)[0]
    back = turn.T @ np.linalg.inv(new)
    widest = min(turning_radius(camera.distortion) ** 2, 1e30)
    return np.concatenate((back.ravel(), numbers_of(camera), [widest])).astype(np.float32)


def sampled(image: Any, numbers: np.ndarray, shape: tuple[int, ...], cval: float) -> Any:
    """Sample a checked image."""
    rt = runtime(image)
    sides = tuple(image.shape)
    dtype = np.dtype(np.uint8 if library(image).dtype(image) == np.uint8 else np.float32)
    channels = (*sides[2:], 1)[0]
    result = rt.empty((*shape, *sides[2:]), dtype)
    src = rt.adopt(image, dtype, (*sides[:2], channels))
    dst = rt.adopt(result, dtype, (*shape, channels))
    rt.geometry.cameras.undistortion.sample(src, rt.constant(numbers), cval, dst)
    return rt.release(result)
