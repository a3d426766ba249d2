"""Draw over photographs."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cvkern._checks import as_array, check_integer, check_number
from cvkern.images import _overlay
from cvkern.images._overlay import check_color


def draw_points(
    image: ArrayLike,
    points: ArrayLike,
    *,
    color: ArrayLike = (255, 64, 64),
    radius: float = 2.0,
) -> np.ndarray:
    """Draw filled discs over an image, anti-aliased and placed to a fraction of a pixel.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4
        uint8, bool, floats in [0, 1], or uint16, whose white is that of :func:`cvkern.sift`. Alpha
        is ignored.
    points : array of shape (N, 2)
        Centres, (row, column), pixels. Parts outside the image are cut off.
    color : array of shape (3,) or (N, 3)
        Red, green, blue in [0, 255], for all or for each.
    radius : float
        Pixels, > 0.

    Returns
    -------
    array of shape (H, W, 3), uint8
        A new array.

    Raises
    ------
    ValueError
        If an argument is out of the ranges above or is not finite.
    """
    canvas, centres = _overlay.canvas(image), _overlay.check_rows(points, 2, "points")
    half = _overlay.check_positive(radius, "radius")
    return _overlay.blend(
        canvas, *_overlay.discs(centres), half, _overlay.check_colors(color, len(centres))
    )


def draw_lines(
    image: ArrayLike,
    segments: ArrayLike,
    *,
    color: ArrayLike = (255, 64, 64),
    width: float = 1.5,
) -> np.ndarray:
    """Draw line segments with round ends over an image, anti-aliased.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4
        The image, as for `draw_points`.
    segments : array of shape (N, 4)
        End points: row, column, row, column, pixels. Parts outside the image are cut off.
    color : array of shape (3,) or (N, 3)
        Red, green, blue in [0, 255], for all or for each.
    width : float
        Pixels, > 0.

    Returns
    -------
    array of shape (H, W, 3), uint8
        A new array.

    Raises
    ------
    ValueError
        If an argument is out of the ranges above or is not finite.
    """
    canvas, ends = _overlay.canvas(image), _overlay.check_rows(segments, 4, "segments")
    half = 0.5 * _overlay.check_positive(width, "width")
    places, distance = _overlay.segments(ends, half, canvas.shape[:2])
    return _overlay.blend(canvas, places, distance, half, _overlay.check_colors(color, len(ends)))


def draw_epipolar_lines(
    image: ArrayLike,
    F: ArrayLike,
    points: ArrayLike,
    *,
    side: int = 0,
    color: ArrayLike = (255, 64, 64),
    width: float = 1.5,
) -> np.ndarray:
    """Draw over one image the lines on which points of the other one lie.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4
        The image in which the lines are, as for `draw_points`.
    F : array of shape (3, 3)
        Fundamental matrix, x1' F x0 = 0 with (x, y, 1).
    points : array of shape (N, 2)
        (row, column) in the other image. An epipole has no line.
    side : int, default 0
        Image of the points: 0 the first, 1 the second. `image` is the other one.
    color : array of shape (3,) or (N, 3)
        Red, green, blue in [0, 255], for all or for each.
    width : float
        Pixels, > 0.

    Returns
    -------
    array of shape (H, W, 3), uint8
        A new array.

    Raises
    ------
    ValueError
        If an argument is out of the ranges above or is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> rectified = [[0, 0, 0], [0, 0, -1], [0, 1, 0]]
    >>> drawn = cvkern.images.draw_epipolar_lines(np.zeros((9, 9)), rectified, [[4, 7]])
    >>> np.flatnonzero(drawn[:, 0, 0]).tolist()  # row 4, and half of its neighbours
    [3, 4, 5]
    """
    from cvkern.geometry._matrices import check_matrix
    from cvkern.geometry.epipolar import epipolar_lines

    matrix = check_matrix(F, (3, 3), "F")
    canvas, places = _overlay.canvas(image), _overlay.check_rows(points, 2, "points")
    colors = _overlay.check_colors(color, len(places))
    lines = epipolar_lines(matrix, places, check_integer(side, "side", 0, 1))
    real = np.isfinite(lines).all(axis=1)
    a, b, c = lines[real].T
    segments = _overlay.across(np.arctan2(b, a), -c, canvas.shape[:2])
    return draw_lines(canvas, segments, color=colors[real], width=width)


def draw_circles(
    image: ArrayLike,
    circles: ArrayLike,
    *,
    color: ArrayLike = (255, 64, 64),
    width: float = 1.5,
) -> np.ndarray:
    """Draw the outlines of circles over an image, anti-aliased.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4
        The image, as for `draw_points`.
    circles : array of shape (N, 3)
        Row and column of the centre, and radius >= 0, pixels. Parts outside are cut off.
    color : array of shape (3,) or (N, 3)
        Red, green, blue in [0, 255], for all or for each.
    width : float
        Width of the outline in pixels, > 0; half of it lies inside the circle.

    Returns
    -------
    array of shape (H, W, 3), uint8
        A new array.

    Raises
    ------
    ValueError
        If an argument is out of the ranges above or is not finite.
    """
    canvas, rings = _overlay.canvas(image), _overlay.check_rows(circles, 3, "circles")
    if (rings[:, 2] < 0).any():
        raise ValueError(f"circles must have radii >= 0, got {rings[:, 2].min()}")
    half = 0.5 * _overlay.check_positive(width, "width")
    places, distance = _overlay.circles(rings, half, canvas.shape[:2])
    return _overlay.blend(canvas, places, distance, half, _overlay.check_colors(color, len(rings)))


def overlay_mask(
    image: ArrayLike,
    mask: ArrayLike,
    *,
    color: tuple[int, int, int] = (255, 64, 64),
    opacity: float = 1.0,
) -> np.ndarray:
    """Colour the pixels of an image where a mask is not zero.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4
        The image, as for `draw_points`.
    mask : array of shape (H, W)
        Bool, or numbers; set where it is not zero.
    color : (red, green, blue)
        In [0, 255].
    opacity : float
        In [0, 1].

    Returns
    -------
    array of shape (H, W, 3), uint8
        A new array.

    Raises
    ------
    ValueError
        If an argument is out of the ranges above, or the shapes differ.
    """
    canvas, on = _overlay.canvas(image), np.asarray(as_array(mask, "mask"))
    if on.shape != canvas.shape[:2]:
        raise ValueError(f"mask must have shape {canvas.shape[:2]}, got {on.shape}")
    if not 0.0 <= check_number(opacity, "opacity", finite=False) <= 1.0:
        raise ValueError(f"opacity must lie in [0, 1], got {opacity}")
    on = on != 0
    mixed = (1.0 - opacity) * canvas[on] + opacity * check_color(color, "color")
    canvas[on] = np.round(mixed).astype(np.uint8)
    return canvas
