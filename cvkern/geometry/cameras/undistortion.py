"""Removal of lens distortion from images, with an optional rotation of the camera."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import as_items, check_image, check_integer, check_number
from cvkern._runtime import runtime
from cvkern.geometry._matrices import check_matrix
from cvkern.geometry.cameras.calibration import numbers_of
from cvkern.geometry.cameras.lens import (
    MOST_SIDE,
    UNKNOWN,
    Camera,
    bent,
    check_lens,
    check_pose,
    turning_radius,
)
from cvkern.kernels.codes.geometry import LENS_SEGMENT

LOOKED_AT = 33  # rows and segments of a picture for which parabolas are compared with the lens
ROUGHEST = 1 / 512  # largest distance of a parabola from the places, pixels: half a step of weights


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
        Image of `camera`, of its shape if that is known; at least 2 x 2, with at most 4 channels.
        Any real dtype.
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
    one kernel and without a map in memory. The weights of bytes are multiples of 1/256. The place
    of a pixel is computed for every sixteenth, and lies on parabolas between them, where these are
    within 1/1000 of a pixel of it.

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
    if camera.shape not in (UNKNOWN, sides[:2]):
        raise ValueError(f"image must have the shape of the camera, {camera.shape}, got {sides}")
    if min(sides[:2]) < 2:
        raise ValueError(f"image must have at least 2 rows and 2 columns, got shape {sides}")
    if len(sides) == 3 and sides[2] > 4:
        raise ValueError(f"image must have at most 4 channels, got {sides[2]}")
    made = sides[:2] if shape is None else as_items(shape, "shape", "rows and columns")
    if len(made) != 2:
        raise ValueError(f"shape must be rows and columns, got {len(made)} numbers")
    made = tuple(check_integer(n, "shape", 1, MOST_SIDE) for n in made)
    cval = check_number(cval, "cval")
    numbers = undistortion_numbers(camera, matrix, rotation, made)
    return sampled(image, numbers, made, cval)


def undistortion_numbers(
    camera: Camera, matrix: Any, rotation: Any, shape: tuple[int, ...]
) -> np.ndarray:
    """Return kernel parameters: the matrix from new pixels to old rays, and the old camera."""
    new = camera.matrix if matrix is None else check_matrix(matrix, (3, 3), "matrix")
    turn = check_pose(rotation, None)[0]
    return _numbers(new.tobytes(), turn.tobytes(), numbers_of(camera).tobytes(), *shape)


@lru_cache
def _numbers(new: bytes, turn: bytes, lens: bytes, height: int, width: int) -> np.ndarray:
    """Return these parameters, from float64 arrays; videos repeat them for each frame."""
    matrix, rotation = (np.frombuffer(a).reshape(3, 3) for a in (new, turn))
    camera = np.frombuffer(lens)
    if np.linalg.matrix_rank(matrix) < 3:
        raise ValueError("matrix must have an inverse, got a matrix of rank below 3")
    back = rotation.T @ np.linalg.inv(matrix)
    widest = min(turning_radius(camera[4:]) ** 2, 1e30)
    numbers = np.concatenate((back.ravel(), camera, [widest]))
    smooth = _is_smooth(numbers, height, width)
    found = np.append(numbers, float(smooth)).astype(np.float32)
    found.flags.writeable = False
    return found


def _is_smooth(values: np.ndarray, height: int, width: int) -> bool:
    """Tell whether parabolas through three places of a segment are as good as all of its places.

    The third derivative along a row, by which they are off, changes slowly: rows and segments are
    looked at on a grid.
    """
    back, lens, widest = values[:9].reshape(3, 3), values[9:18], values[18]
    rows = np.linspace(0, height - 1, min(height, LOOKED_AT)).round()
    last = (width - 1) // LENS_SEGMENT
    begins = LENS_SEGMENT * np.linspace(0, last, min(last + 1, LOOKED_AT)).round()
    shares = np.array([0, 0.25, 0.5, 0.75, 1])  # an error of the third degree is largest near 0.2
    i, j, t = np.meshgrid(rows, begins, LENS_SEGMENT * shares, indexing="ij")
    rays = np.stack((j + t, i, np.ones_like(i)), axis=-1) @ back.T
    with np.errstate(all="ignore"):  # rays may be behind
        flat = rays[..., :2] / rays[..., 2:]
        places = bent(flat.reshape(-1, 2), lens[4:]).reshape(flat.shape) * lens[:2]
        used = (rays[..., [0, -1], 2] > 0) & ((flat[..., [0, -1], :] ** 2).sum(axis=-1) < widest)
        start, first, middle, third, end = np.moveaxis(places, 2, 0)
        off = np.maximum(
            np.abs((3 * start + 6 * middle - end) / 8 - first),
            np.abs((3 * end + 6 * middle - start) / 8 - third),
        ).max(axis=-1)
    return not (off > ROUGHEST)[used.all(axis=-1)].any()


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
