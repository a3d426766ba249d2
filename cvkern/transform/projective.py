"""Transformation of images by a homography."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._checks import as_items, as_numbers, check_flag, check_number, check_sides
from cvkern._runtime import runtime
from cvkern.transform.sampling import check_sampled, layout, result_dtype, sampled, shaped

MAX_SIDE = 2**16
SINGULAR = 1e-12  # least determinant of a matrix whose columns have 1 as their largest element


def warp_perspective(
    image: Any,
    matrix: Any,
    shape: Sequence[int] | None = None,
    *,
    order: int = 1,
    mode: str = "constant",
    cval: float = 0.0,
    channel_axis: int | None = None,
    dtype: Any = None,
) -> Any:
    """Warp an image by a homography.

    Parameters
    ----------
    image : array of shape (H, W), (H, W, C) or (C, H, W)
        Any real dtype.
    matrix : array of shape (3, 3)
        Maps a pixel (x, y, 1) of `image`, x = column and y = row, to a pixel of the result, up to a
        factor: the matrix of ``cv2.warpPerspective``.
    shape : (int, int), optional
        Height and width of the result; those of `image` by default.
    order, mode, cval, channel_axis, dtype
        As in :func:`remap`.

    Returns
    -------
    array of shape (H', W'), (H', W', C) or (C, H', W'), float32 or uint8

    Raises
    ------
    TypeError
        If `image` does not hold real numbers, or `dtype` is neither float32 nor uint8.
    ValueError
        If `image` is empty or of a wrong rank, `matrix` is not (3, 3), finite and invertible,
        `shape` is not of two sides of at most 65536, or an option is unknown.

    Notes
    -----
    ``cv2.warpPerspective`` of OpenCV 4 rounds coordinates to 1/32 pixel; this does not.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> right_by_one = [[1, 0, 1], [0, 1, 0], [0, 0, 1]]
    >>> cvkern.warp_perspective([[1, 2, 3]], right_by_one)
    array([[0., 1., 2.]], dtype=float32)
    """
    inverse = _inverse(matrix)
    image, axis, order, border, cval = check_sampled(image, order, mode, cval, channel_axis)
    old = tuple(image.shape)
    sides = layout(old, axis)[1:3] if shape is None else check_sides(shape, "shape")
    rt = runtime(image)
    made = result_dtype(image, order, dtype)
    result = rt.empty(shaped(old, sides, axis), made)
    src, margin = sampled(rt, image, axis, order, border)
    dst = rt.adopt(result, made, shape=layout(tuple(result.shape), axis))
    numbers = rt.constant(inverse.reshape(9))
    rt.transform.projective.warp_perspective(src, numbers, order, border, cval, margin, dst)
    return rt.release(result)


def rotate(
    image: Any,
    angle: float,
    *,
    resize: bool = False,
    center: Sequence[float] | None = None,
    order: int = 1,
    mode: str = "constant",
    cval: float = 0.0,
    channel_axis: int | None = None,
    dtype: Any = None,
) -> Any:
    """Rotate an image about a point.

    Parameters
    ----------
    image : array of shape (H, W), (H, W, C) or (C, H, W)
        Any real dtype.
    angle : float
        Degrees, counter-clockwise on the screen.
    resize : bool, default False
        Enlarge the result to hold the whole image; else it has the size of the image.
    center : (float, float), optional
        Row and column of the fixed point; the middle of the image by default. It is ignored with
        `resize`.
    order, mode, cval, channel_axis, dtype
        As in :func:`remap`.

    Returns
    -------
    array of shape (H', W'), (H', W', C) or (C, H', W'), float32 or uint8

    Raises
    ------
    TypeError
        If `image` does not hold real numbers, or `dtype` is neither float32 nor uint8.
    ValueError
        If `image` is empty or of a wrong rank, `angle` or `center` is not finite, or an option
        is unknown.

    Notes
    -----
    As :func:`skimage.transform.rotate`.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.rotate([[1, 2], [3, 4]], 90).round(3)
    array([[2., 4.],
           [1., 3.]], dtype=float32)
    """
    resize = check_flag(resize, "resize")
    image, axis, *_ = check_sampled(image, order, mode, cval, channel_axis)
    height, width = layout(tuple(image.shape), axis)[1:3]
    turn = math.radians(check_number(angle, "angle"))
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    if center is not None:
        center = as_items(center, "center", "a row and a column")
        if len(center) != 2:
            raise ValueError(f"center must be a row and a column, got {len(center)} numbers")
        middle = np.array([check_number(c, "center") for c in reversed(center)])
    # Right angles have no rounding, which would push pixels over the border.
    cos, sin = round(math.cos(turn), 15), round(math.sin(turn), 15)
    about = np.array([[cos, sin], [-sin, cos]])  # y points down
    sides, target = (height, width), middle
    if resize:
        span = np.abs(about) @ np.array([width - 1, height - 1])
        sides = (int(np.around(span[1] + 1)), int(np.around(span[0] + 1)))
        middle = np.array([(width - 1) / 2, (height - 1) / 2])
        target = span / 2
    matrix = np.eye(3)
    matrix[:2, :2] = about
    matrix[:2, 2] = target - about @ middle
    return warp_perspective(
        image, matrix, sides, order=order, mode=mode, cval=cval, channel_axis=channel_axis,
        dtype=dtype,
    )  # fmt: skip


def rectify_plane(
    image: Any,
    corners: Any,
    size: Sequence[int],
    *,
    order: int = 1,
    mode: str = "constant",
    cval: float = 0.0,
    channel_axis: int | None = None,
    dtype: Any = None,
) -> Any:
    """Rectify a quadrilateral of an image, such as a sheet or a facade, to a rectangle.

    Parameters
    ----------
    image : array of shape (H, W), (H, W, C) or (C, H, W)
        Any real dtype.
    corners : array of shape (4, 2)
        Rows and columns of the corners, in the order top left, top right, bottom right, bottom
        left of the result.
    size : (int, int)
        Height and width of the result. Its corner pixels have their centres on the corners.
    order, mode, cval, channel_axis, dtype
        As in :func:`remap`.

    Returns
    -------
    array of shape (H', W'), (H', W', C) or (C, H', W'), float32 or uint8

    Raises
    ------
    TypeError
        If `image` does not hold real numbers, or `dtype` is neither float32 nor uint8.
    ValueError
        If `image` is empty or of a wrong rank, `corners` are not those of a convex quadrilateral,
        one after the other, `size` is not of two sides from 2 to 65536, or an option is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> picture = np.arange(16).reshape(4, 4)
    >>> cvkern.rectify_plane(picture, [(0, 1), (0, 3), (2, 3), (2, 1)], (3, 3))
    array([[ 1.,  2.,  3.],
           [ 5.,  6.,  7.],
           [ 9., 10., 11.]], dtype=float32)
    """
    points = as_numbers(corners, "corners")
    if points.shape != (4, 2) or not np.isfinite(points).all():
        raise ValueError(f"corners must be (4, 2) finite numbers, got shape {points.shape}")
    sides = check_sides(size, "size", 2)
    y, x = sides[0] - 1.0, sides[1] - 1.0
    matrix = _four_points(points, np.array([[0, 0], [0, x], [y, x], [y, 0]]))
    return warp_perspective(
        image, matrix, sides, order=order, mode=mode, cval=cval, channel_axis=channel_axis,
        dtype=dtype,
    )  # fmt: skip


def _inverse(matrix: Any) -> np.ndarray:
    numbers = as_numbers(matrix, "matrix")
    if numbers.shape != (3, 3) or not np.isfinite(numbers).all():
        raise ValueError(f"matrix must be (3, 3) finite numbers, got shape {numbers.shape}")
    if is_singular(numbers):
        raise ValueError("matrix must be invertible, got one that is not")
    return np.linalg.inv(numbers)


def is_singular(matrix: np.ndarray) -> bool:
    """Tell whether a homography takes the plane to a line or a point, or nearly so."""
    # Columns are brought to one size first: translations are large numbers of pixels.
    scale = np.abs(matrix).max(axis=0)
    return not scale.all() or bool(abs(np.linalg.det(matrix / scale)) < SINGULAR)


def _four_points(points: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Return the homography that maps four points (row, column) to four others."""
    rows = []
    for (y, x), (v, u) in zip(points, targets, strict=True):
        rows.append([x, y, 1, 0, 0, 0, -u * x, -u * y])
        rows.append([0, 0, 0, x, y, 1, -v * x, -v * y])
    # All seen rectangles turn the same way at each corner, and clearly.
    sides = np.roll(points, -1, axis=0) - points
    after = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]
    least = 1e-9 * max(1.0, np.ptp(points, axis=0).max()) ** 2
    if not ((turns > least).all() or (turns < -least).all()):
        raise ValueError(
            "corners must go round a quadrilateral without a dent, no three on a line, got others"
        )
    found = np.linalg.solve(np.array(rows), targets[:, ::-1].ravel())
    return np.append(found, 1.0).reshape(3, 3)
