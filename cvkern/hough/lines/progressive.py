"""Segments of a mask by the progressive probabilistic Hough transform."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cvkern._checks import (
    as_numbers,
    check_accumulator,
    check_image,
    check_integer,
    check_sides,
)
from cvkern._runtime import refuse_capture, runtime
from cvkern.hough._points import mask_points
from cvkern.kernels.codes.hough import STEPS, SegmentRule

MOST_SEGMENTS = 1 << 15


def probabilistic_hough_line(
    image: Any,
    threshold: int = 10,
    line_length: int = 50,
    line_gap: int = 10,
    theta: Any = None,
    rng: Any = None,
) -> Any:
    """Find segments of set pixels by the progressive probabilistic Hough transform.

    Set pixels vote in a random order. As soon as a line has enough votes, the set pixels along it
    are followed from the last voter to both sides. A segment that is long enough is taken out with
    its votes.

    Parameters
    ----------
    image : array of shape (H, W)
        Edge pixels: any real dtype, set where it is not 0.
    threshold : int, default 10
        Least votes of a line, at least 1.
    line_length : int, default 50
        Least length of a segment along the rows or the columns, pixels.
    line_gap : int, default 10
        Most empty pixels between two set ones of a segment.
    theta : array of shape (T,), optional
        Angles of the lines' normals, radians. By default 180 angles from -pi / 2 on, evenly spaced.
    rng : int or numpy.random.Generator, optional
        Source of the order of votes, as of :func:`numpy.random.default_rng`. An int gives the same
        segments in every run.

    Returns
    -------
    array of shape (N, 4), int32
        Row and column of one end, then of the other. At most 32768 segments.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or a parameter is no integer.
    ValueError
        If `image` is empty, not 2-D or has a side longer than 65536; `theta` is not a list of
        finite numbers; or a parameter is too small.

    See Also
    --------
    hough_line_segments : Segments along given lines, without a random order.
    detect_segments : Segments of a photograph, to a fraction of a pixel.

    Notes
    -----
    Equal to :func:`skimage.transform.probabilistic_hough_line` of scikit-image 0.25 and later with
    the same `rng`, which lists columns before rows. Each point depends on those before it, so one
    thread does the work, on a GPU too.

    References
    ----------
    .. [1] C. Galambos, J. Matas and J. Kittler, "Progressive probabilistic Hough transform for line
       detection", CVPR 1999.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> mask = np.zeros((30, 80), bool)
    >>> mask[12, 5:75] = True
    >>> np.sort(cvkern.probabilistic_hough_line(mask, rng=0).reshape(2, 2), axis=0)
    array([[12,  5],
           [12, 74]], dtype=int32)
    """
    image = check_image(image)
    height, width = check_sides(image.shape, "image")
    rule = SegmentRule(
        check_integer(threshold, "threshold", 1, 2**31 - 1),
        check_integer(line_length, "line_length", 0, 2**31 - 1),
        check_integer(line_gap, "line_gap", 0, 2**31 - 2),
    )
    angles = _angles(theta)
    refuse_capture("the order of votes, which is drawn on the host")
    generator = _generator(rng)
    turns = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    bins = 2 * math.ceil(math.hypot(height, width)) + 2
    check_accumulator((len(angles), bins), "votes")
    rt = runtime(image)
    found = mask_points(rt, image, "progressive")
    number = int(rt.to_numpy(found.starts)[-1])
    if not number:
        return rt.give(np.zeros((0, 4), np.int32))
    order = np.arange(number)
    generator.shuffle(order)
    points = rt.to_numpy(found.points[:number])[order[::-1]]
    left = np.zeros((height, width), np.uint8)
    left[points[:, 0], points[:, 1]] = 1
    segments = rt.scratch("progressive.segments", (min(number, MOST_SEGMENTS), 4), np.int32)
    count = rt.zeros((1,), np.int32)
    rt.hough.lines.progressive.follow(
        rt.send("points", points), rt.send("turns", turns), rt.send("steps", _steps(turns)), rule,
        rt.send("left", left), rt.zeros((len(angles), bins), np.int32), segments, count,
    )  # fmt: skip
    return rt.give(rt.to_numpy(segments)[: int(rt.to_numpy(count)[0])].copy())


def _angles(theta: Any) -> np.ndarray:
    if theta is None:
        return np.linspace(-np.pi / 2, np.pi / 2, 180, endpoint=False)
    angles = as_numbers(theta, "theta")
    if angles.ndim != 1 or not len(angles) or not np.isfinite(angles).all():
        raise ValueError(
            f"theta must be a list of one or more finite numbers, got shape {angles.shape}"
        )
    return angles


def _generator(rng: Any) -> np.random.Generator:
    try:
        return np.random.default_rng(rng)
    except (TypeError, ValueError) as error:
        raise TypeError(f"rng must be a seed or a NumPy generator, got {rng!r}: {error}") from None


def _steps(turns: np.ndarray) -> np.ndarray:
    """Return the steps along lines, down and to the right, and whether lines are flat, int32."""
    down, right = turns[:, 0], -turns[:, 1]
    flat = np.abs(right) > np.abs(down)
    slope = np.where(flat, down, right) * STEPS / np.maximum(np.abs(down), np.abs(right))
    slope = np.trunc(slope + np.where(slope > 0, 0.5, -0.5))
    along_y = np.where(flat, slope, np.where(down > 0, 1, -1))
    along_x = np.where(flat, np.where(right > 0, 1, -1), slope)
    return np.stack((along_y, along_x, flat), axis=1).astype(np.int32)
