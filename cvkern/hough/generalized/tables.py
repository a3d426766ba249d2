"""Arbitrary shapes as tables of their boundary points."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import as_numbers, check_photograph
from cvkern.hough.generalized._ballot import MAX_ANGLE, scene_of
from cvkern.kernels.codes.hough import DIRECTIONS

SIGMA = 1.0
MAX_RADIUS = 2**12  # pixels: largest distance of a boundary point from the reference


class RTable(NamedTuple):
    """A shape as its boundary: the vector from each boundary point to the reference point.

    The entries are sorted by direction, so that votes can look them up. All arrays are NumPy's.
    """

    vectors: np.ndarray
    """Rows and columns from the boundary point to the reference point, (N, 2) float32."""
    orientation: np.ndarray
    """Direction of the gradient at the boundary point, in radians, ascending, (N,) float32."""
    reference: np.ndarray
    """Row and column of the reference point in the template, (2,) float64."""
    shape: tuple[int, int]
    """Rows and columns of the template."""


def r_table(
    template: Any,
    *,
    reference: tuple[float, float] | None = None,
    orientation: Any = None,
    sigma: float = SIGMA,
    low_threshold: float | None = None,
    high_threshold: float | None = None,
    use_quantiles: bool = False,
) -> RTable:
    """Describe a shape by its boundary points, for :func:`generalized_hough`.

    Parameters
    ----------
    template : array of shape (H, W) or (H, W, C) with C in 3, 4
        A picture of the shape, any real dtype; :func:`cvkern.canny` finds its edges. With
        `orientation`, a mask (H, W) that is not 0 on the boundary.
    reference : pair of float, optional
        Row and column of the point whose position will be found; the centre by default.
    orientation : array of shape (H, W), optional
        Direction of the gradient at the pixels of the mask, in radians.
    sigma, low_threshold, high_threshold, use_quantiles
        As in :func:`cvkern.canny`, for derivatives of the Gaussian; ignored for a mask. By
        default the thresholds are those of :func:`cvkern.detect_circles`.

    Returns
    -------
    RTable
        Named tuple of `vectors` (N, 2) and `orientation` (N,) float32, sorted by orientation,
        `reference` (2,) float64, and `shape`. These are NumPy arrays for every kind of template.

    Raises
    ------
    TypeError
        If `template` or `orientation` do not hold real numbers.
    ValueError
        If `template` is empty or of another shape, has no boundary point, or one farther than 4096
        pixels from the reference; if `reference` is not two finite numbers; if `orientation` has
        another shape than the mask, or is outside -7 to 7 at a point; as in :func:`cvkern.canny`;
        and within :func:`cvkern.capture`, because the host counts the points.

    References
    ----------
    .. [1] D. H. Ballard, "Generalizing the Hough transform to detect arbitrary shapes", Pattern
       Recognition 13(2), 1981.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> square = np.zeros((21, 21))
    >>> square[5:16, 5:16] = 1
    >>> table = cvkern.r_table(square, sigma=1.0)
    >>> table.reference
    array([10., 10.])
    >>> bool((abs(table.vectors).max(axis=1) < 7).all())
    True
    """
    template = check_photograph(template, "template")
    options = sigma, low_threshold, high_threshold, use_quantiles
    shape = tuple(template.shape[:2])
    centre = _check_reference(reference, shape)
    scene = scene_of(template, orientation, options, "template")
    if not len(scene.points):
        raise ValueError("template must have boundary points, got none")
    vectors = centre - scene.points
    radius = float(np.hypot(*vectors.T).max())
    if radius > MAX_RADIUS:
        raise ValueError(
            f"template must have its boundary within {MAX_RADIUS} pixels of the reference, "
            f"got {radius:g}"
        )
    codes = (scene.codes + DIRECTIONS // 2) % DIRECTIONS - DIRECTIONS // 2  # -pi to pi
    order = np.argsort(codes, kind="stable")
    angles = codes[order] * (2 * math.pi / DIRECTIONS)
    return RTable(
        vectors[order].astype(np.float32), angles.astype(np.float32), centre, (shape[0], shape[1])
    )


def _check_reference(reference: Any, shape: tuple[int, ...]) -> np.ndarray:
    if reference is None:
        return (np.array(shape) - 1) / 2
    try:
        centre = as_numbers(reference, "reference")
    except (TypeError, ValueError):
        raise TypeError(f"reference must be numbers, got {reference!r}") from None
    if centre.shape != (2,) or not np.isfinite(centre).all():
        raise ValueError(f"reference must be two finite numbers, got {reference!r}")
    return centre


def check_table(table: Any) -> RTable:
    """Return a checked table with its entries as NumPy arrays."""
    if not isinstance(table, RTable):
        raise TypeError(f"table must be an RTable, got {type(table).__name__}")
    vectors, angles = np.asarray(table.vectors), np.asarray(table.orientation)
    count = len(vectors)
    if not count or vectors.shape != (count, 2) or angles.shape != (count,):
        raise ValueError(
            "table must have vectors of shape (N, 2) and orientation of shape (N,), N >= 1, "
            f"got {vectors.shape} and {angles.shape}"
        )
    if not (np.abs(vectors) <= MAX_RADIUS).all() or not (np.abs(angles) <= MAX_ANGLE).all():
        raise ValueError(
            f"table must have vectors of at most {MAX_RADIUS} pixels and angles within -7 to 7, "
            "got others"
        )
    return table._replace(vectors=vectors, orientation=angles)
