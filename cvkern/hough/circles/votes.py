"""The Hough transform for circles."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from cvkern._checks import (
    as_numbers,
    check_accumulator,
    check_beside,
    check_flag,
    check_integer,
    check_number,
)
from cvkern._runtime import runtime
from cvkern.hough._points import check_at_points, check_masks, mask_points
from cvkern.kernels.codes.hough import DIRECTIONS, Rings

MAX_RADIUS = 2**14  # times 2^16 (the scale of the direction tables), it stays within 32 bits
ALONG = -1  # tolerance code: vote for the two pixels along the gradient, not for arcs


def hough_circle(
    mask: Any,
    radius: Any,
    *,
    normalize: bool = True,
    full_output: bool = False,
    orientation: Any = None,
    orientation_tolerance: float = 0.0,
    batch_axis: int | None = None,
) -> Any:
    """Count, for every centre and radius, the set pixels on the circle.

    Parameters
    ----------
    mask : array of shape (H, W), or a stack of them
        Edge pixels: any real dtype, set where it is not 0.
    radius : int or sequence of R ints
        Radii in pixels, from 1 to the diagonal of the image.
    normalize : bool, default True
        Divide the votes by the number of offsets of the circle, which gives its visible share.
    full_output : bool, default False
        Also count for centres outside the image, as far away as the largest radius.
    orientation : array of the shape of `mask`, optional
        Direction of the gradient in radians (:func:`cvkern.gradient`). A set pixel then votes only
        along its gradient, to both sides, instead of in all directions. This gives far fewer wrong
        votes.
    orientation_tolerance : float, default 0.0
        Radians. With 0, a pixel p votes for the two centres ``p +- round(radius * direction)``.
        Above 0, it votes for the offsets of the circle whose direction differs from the gradient's,
        or from its opposite, by at most this angle.
    batch_axis : {0}, optional
        Axis of the masks in a stack, (N, H, W); on a GPU all vote in one launch.

    Returns
    -------
    array of shape (R, H, W), or (R, H + 2 M, W + 2 M) with `full_output`, M the largest radius
        float32 shares, or int32 votes where `normalize` is False. The centre (row, column) is at
        ``[:, row + M, column + M]`` of the full output. A stack has one more axis in front.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or a radius is not an integer.
    ValueError
        If an array is empty, of another rank, or longer than 65536 on a side, or the arrays differ
        in shape; if there is no radius, or one is below 1, above 16384, or above the diagonal
        without `full_output`; if the result would have more than 2^29 elements; if `orientation` is
        NaN or beyond a full turn at a set pixel, or the tolerance is negative or not below pi / 2.

    Notes
    -----
    Without `orientation` the votes are those of ``skimage.transform.hough_circle``. Its circles
    are Bresenham's; they count the four pixels on the axes twice, and for some radii also those on
    the diagonals. With `orientation`, directions are rounded to 1/16384 of a turn, and products of
    radius and direction are rounded half up. The votes are the same on every device and kernel
    set.

    References
    ----------
    .. [1] R. O. Duda and P. E. Hart, "Use of the Hough transformation to detect lines and curves
       in pictures", Communications of the ACM 15(1), 1972.
    .. [2] C. Kimme, D. Ballard and J. Sklansky, "Finding circles by an array of accumulators",
       Communications of the ACM 18(2), 1975 (votes along the gradient).

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> y, x = np.mgrid[:21, :21]
    >>> ring = np.abs(np.hypot(y - 12, x - 9) - 6) < 0.5
    >>> votes = cvkern.hough_circle(ring, [5, 6, 7])
    >>> np.unravel_index(votes.argmax(), votes.shape)
    (np.int64(1), np.int64(12), np.int64(9))
    """
    mask, shape = check_masks(mask, batch_axis)
    normalize = check_flag(normalize, "normalize")
    full_output = check_flag(full_output, "full_output")
    farthest = MAX_RADIUS if full_output else int(math.hypot(shape[0] - 1, shape[1] - 1))
    radii = _check_radii(radius, farthest)
    tolerance = check_number(orientation_tolerance, "orientation_tolerance", low=0)
    if tolerance >= math.pi / 2:
        raise ValueError(f"orientation_tolerance must be < pi / 2, got {tolerance:g}")
    orientation = check_beside(orientation, tuple(mask.shape), "orientation")
    pad = max(radii) if full_output else 0
    stack = tuple(mask.shape)[:-2]
    size = (*stack, len(radii), shape[0] + 2 * pad, shape[1] + 2 * pad)
    check_accumulator(size, "votes")
    rt = runtime(mask, orientation)
    rings = Rings(*map(rt.constant, _rings(radii)))
    dtype = np.float32 if normalize else np.int32
    votes = rt.empty(size, dtype)
    if orientation is None:
        view = rt.adopt_mask(mask)
        rt.hough.circles.votes.vote_rings(view, rings, max(radii), rt.adopt(votes, dtype))
    else:
        angles = rt.adopt(orientation)
        found = mask_points(rt, mask, "circles")
        check_at_points(rt, found, angles, "orientation", -2 * math.pi, 2 * math.pi)
        units = min(round(tolerance * DIRECTIONS / (2 * math.pi)), DIRECTIONS // 4 - 1)
        rt.hough.circles.votes.vote_directed(
            found.points, found.starts, angles, rings, rt.constant(direction_table()),
            units if tolerance else ALONG, rt.adopt(votes, dtype),
        )  # fmt: skip
    return rt.release(votes)


def _check_radii(radius: Any, farthest: int, name: str = "radius") -> tuple[int, ...]:
    given = as_numbers(radius, name, object)
    if given.ndim > 1 or given.size == 0:
        raise ValueError(f"{name} must be one integer or a sequence of them, got {radius!r}")
    return tuple(check_integer(r, name, 1, farthest) for r in given.reshape(-1).tolist())


@lru_cache(maxsize=8)
def _rings(radii: tuple[int, ...]) -> Rings:
    """Return the offsets of the circles, each sorted by the codes of their directions."""
    rings = [_ring(radius) for radius in radii]
    codes = [
        np.floor(np.arctan2(*ring.T) * (DIRECTIONS / (2 * math.pi)) + 0.5).astype(np.int32)
        % DIRECTIONS
        for ring in rings
    ]
    orders = [np.lexsort((*ring.T, code)) for ring, code in zip(rings, codes, strict=True)]
    return Rings(
        np.array(radii, np.int32),
        np.concatenate([ring[order] for ring, order in zip(rings, orders, strict=True)]),
        np.concatenate([code[order] for code, order in zip(codes, orders, strict=True)]),
        np.cumsum([0, *map(len, rings)], dtype=np.int32),
    )


def _ring(radius: int) -> np.ndarray:
    """Return the offsets of Bresenham's circle, (N, 2) int32, octant by octant.

    Starting at (radius, 0), each step moves to the next column, and also one row towards the centre
    if that pixel is nearer to the circle: if the mean of the two squared distances from the centre
    is at least the squared radius.
    """
    octant = []
    y, x = radius, 0
    while y >= x:
        octant.append((y, x))
        x += 1
        if 2 * x * x + y * y + (y - 1) * (y - 1) >= 2 * radius * radius:
            y -= 1
    one = np.array(octant, np.int32)
    both = np.concatenate((one, one[:, ::-1]))
    return np.concatenate([both * sign for sign in ((1, 1), (1, -1), (-1, 1), (-1, -1))]).astype(
        np.int32
    )


@lru_cache(maxsize=1)
def direction_table() -> np.ndarray:
    """Return sine and cosine of each direction code times 2^16, (DIRECTIONS, 2) int32."""
    angle = np.arange(DIRECTIONS) * (2 * math.pi / DIRECTIONS)
    return np.round(np.stack((np.sin(angle), np.cos(angle)), axis=1) * 65536).astype(np.int32)
