"""Circles in a photograph: centres first, then radii, then a least-squares fit."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import (
    as_numbers,
    check_choice,
    check_number,
    check_photograph,
    check_positive,
    check_sides,
)
from cvkern._runtime import Runtime, runtime
from cvkern._stacks import one_by_one
from cvkern.edges.masks import find_edges, photograph_options
from cvkern.filters.channels import Planes, planes_of
from cvkern.hough.circles.peaks import local_maxima
from cvkern.kernels.codes.filters import Border
from cvkern.kernels.codes.hough import ARCS, FINE_ONE, LINE_ONE, NORMAL_ONE, Aim

POLARITIES = {"any": (1, -1), "bright": (1, 1), "dark": (-1, -1)}  # sides of the gradient

FINEST = 12  # pixels: a photograph is reduced until its smallest radius is less than twice this
WIDEST = 64  # cells: the cells grow until the largest radius spans at most this many
CANDIDATES = 256  # centres whose radii are searched
RADII = 3  # most concentric circles around one centre
FOCUS = 1.3  # least votes near a centre per point of its circle; two to four were measured
SLOPE = 0.12  # radians: largest angle between a gradient and the direction to the centre
SPREAD = np.array([1, 4, 6, 4, 1], np.float32)  # smooths the accumulator; exact in float32
FITS = 2
BAND = 2.0  # pixels: largest distance of a point from its circle
# Edge points of a whole circle of radius 1. An edge has one point in each row or column it crosses.
WHOLE = 4 * math.sqrt(2)
_SLOPES = np.arctan(np.arange(ARCS // 8 + 1) / (ARCS // 8))
_CROSSED = np.diff(np.sin(_SLOPES))  # rows or columns that each arc of radius 1 crosses
_SCALES = 1 / np.array(
    [NORMAL_ONE**2] * 3 + [NORMAL_ONE] * 2 + [1] + [NORMAL_ONE * FINE_ONE] * 2 + [FINE_ONE]
)


class Circles(NamedTuple):
    """Circles in order of decreasing support."""

    centers: Any
    """Row and column, in pixels with integer centres, (N, 2) float32."""
    radii: Any
    """Radius in pixels, (N,) float32."""
    support: Any
    """Share of the perimeter along which edge points were found, (N,) float32."""


def detect_circles(
    image: Any,
    radius_range: tuple[float, float] | None = None,
    *,
    sigma: float | None = None,
    low_threshold: float | None = None,
    high_threshold: float | None = None,
    polarity: str = "any",
    min_support: float = 0.5,
    min_distance: float | None = None,
    batch_axis: int | None = None,
) -> Any:
    """Find the circles in a photograph.

    Each edge point votes for centres along its gradient, over the range of radii. All radii share
    one accumulator. For each peak, the distances of the points whose gradients aim at it give the
    radii. A least-squares fit to the points near each circle gives the result with sub-pixel
    accuracy. Of circles whose centres are close, only the one with the largest support is kept.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4, or a stack of them
        Any real dtype; colour as in :func:`canny`.
    radius_range : two floats, optional
        Smallest and largest radius, in pixels, at least 3. By default a fortieth and a half of the
        shorter side, or 3 if these are less. If the smallest is 24 or more, the photograph is first
        reduced by an integer factor, so that it becomes less than 24.
    sigma : float, optional
        Standard deviation of the Gaussian that smooths before edge detection, in pixels of the
        reduced photograph. By default a sixth of the smallest radius there, but at least 1
        and at most 2.
    low_threshold, high_threshold : float, optional
        Thresholds of :func:`canny` on the reduced photograph. By default the quantiles 0.7 and 0.9
        of its gradients, but at least 2 % of the longest. If only one is given, the lower is half
        of the higher.
    polarity : {'any', 'bright', 'dark'}, default 'any'
        Find discs that are brighter than their surroundings, darker ones, or both.
    min_support : float, default 0.5
        Smallest share of the perimeter that must be visible, in (0, 1].
    min_distance : float, optional
        Smallest distance between centres. By default the smallest radius.
    batch_axis : {0}, optional
        Axis of the images in a stack, (N, H, W) or (N, H, W, 3 or 4). The result is then a list
        with one result for each image, because their lengths differ.

    Returns
    -------
    Circles, or list of them
        Named tuple of `centers` (N, 2), `radii` and `support` (N,), float32.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers, or an option is not a number.
    ValueError
        If `image` is empty, of another shape, or longer than 65536 on a side; if `radius_range` is
        not two ascending numbers of at least 3, or its first is larger than half the shorter side;
        if `polarity` is unknown, `min_support` not in (0, 1], or `min_distance` negative; and as in
        :func:`canny`.

    Notes
    -----
    Centres lie inside the image. A gradient may miss the centre by 0.12 radians and a pixel or two.
    The blurred edge of a disc lies ``sigma^2 / (2 r)`` inside the true edge; the radii are
    corrected for that.

    References
    ----------
    .. [1] C. Kimme, D. Ballard and J. Sklansky, "Finding circles by an array of accumulators",
       Communications of the ACM 18(2), 1975.
    .. [2] H. K. Yuen, J. Princen, J. Illingworth and J. Kittler, "Comparative study of Hough
       transform methods for circle finding", Image and Vision Computing 8(1), 1990.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> y, x = np.mgrid[:80, :90]
    >>> disc = 200.0 * (np.hypot(y - 41.3, x - 37.8) < 20)
    >>> circles = cvkern.detect_circles(disc, (10, 30), high_threshold=80)
    >>> circles.centers.round(), circles.radii.round()
    (array([[41., 38.]], dtype=float32), array([20.], dtype=float32))
    """
    if batch_axis is not None:
        return one_by_one(detect_circles, locals())
    image = check_photograph(image)
    height, width = check_sides(image.shape[:2], "image")
    side = min(height, width)
    if radius_range is None:
        radius_range = max(side / 40, 3.0), max(side / 2, 3.0)
    low, high = check_range(radius_range, side, "radius_range")
    first, last = POLARITIES[check_choice(polarity, tuple(POLARITIES), "polarity")]
    least = check_support(min_support)
    apart = low if min_distance is None else check_number(min_distance, "min_distance", low=0)
    rt = runtime(image)
    factor = max(1, int(low / FINEST))
    sigma = (
        min(max(low / factor / 6, 1.0), 2.0) if sigma is None else check_positive(sigma, "sigma")
    )
    lines = edge_lines(rt, image, factor, sigma, low_threshold, high_threshold)
    circles, support = np.empty((0, 3), np.float32), np.empty(0, np.float32)
    if lines is not None:
        sides = first, last
        shape = height // factor, width // factor
        reach = low / factor, min(high / factor, math.hypot(*shape))  # no larger circle is visible
        centers, cell = _centers(rt, lines, reach, shape, sides, least)
        circles = _radii(rt, lines, centers, reach, cell, sides, least)
        circles, support = _fitted(rt, lines, circles, sides)
        circles[:, 2] += sigma * sigma / (2 * circles[:, 2])
        circles *= np.float32(factor)
        circles[:, :2] += (factor - 1) / 2
        kept = (support >= least) & (circles[:, 2] >= low - 1) & (circles[:, 2] <= high + 1)
        circles, support = circles[kept], support[kept]
        best = distinct(circles, support, apart)
        circles, support = circles[best], support[best]
    return Circles(*(rt.give(a) for a in (circles[:, :2].copy(), circles[:, 2].copy(), support)))


def check_range(value: Any, side: int, name: str) -> tuple[float, float]:
    """Return the smallest and the largest radius to search for in an image."""
    given = tuple(as_numbers(value, name, object).reshape(-1).tolist())
    if len(given) != 2:
        raise ValueError(f"{name} must be two numbers, got {value!r}")
    low, high = (check_number(r, name, low=3) for r in given)
    if low > high:
        raise ValueError(f"{name} must rise, got {low:g} to {high:g}")
    if low > side / 2:
        raise ValueError(f"{name} must begin at most at {side / 2:g}, got {low:g}")
    return low, high


def check_support(value: Any) -> float:
    """Return the smallest share of a perimeter, checked."""
    least = check_number(value, "min_support", low=0)
    if not 0 < least <= 1:
        raise ValueError(f"min_support must be in (0, 1], got {value}")
    return least


def edge_lines(
    rt: Runtime, image: Any, factor: int, sigma: float, low: float | None, high: float | None
) -> Any:
    """Return row, column, and sine and cosine of the direction of N edge points, (4, N).

    Return None if there is no point. The points are those of a reduced image, whose pixels are the
    means of squares of `factor` x `factor` pixels.
    """
    options = photograph_options(image, sigma, low, high)
    small = image if factor == 1 else _shrunk(rt, image, factor)
    shape = tuple(small.shape[:2])
    mask = rt.scratch("circles.mask", shape, bool)
    dy, dx = find_edges(rt, small, options, mask)
    starts = rt.scratch("circles.starts", (shape[0] + 1,), np.int32)
    rt.hough.points.count(mask, starts)
    count = int(rt.to_numpy(starts)[-1])
    if not count:
        return None
    pixels = rt.scratch("circles.pixels", (count, 2), np.int32)
    rt.hough.points.gather(mask, starts, pixels)
    lines = rt.scratch("circles.lines", (4, count))
    rt.hough.circles.detection.aim(dy, dx, pixels, lines)
    return lines


def _shrunk(rt: Runtime, image: Any, factor: int) -> Planes:
    """Return the means of squares of `factor` x `factor` pixels, of each channel."""
    byte = library(image).dtype(image) == np.uint8
    planes = planes_of(rt, image, np.uint8 if byte else np.float32)
    height, width = planes.shape
    small = []
    for c, plane in enumerate(planes.values):
        small.append(rt.scratch(f"circles.small.{c}", (height // factor, width // factor)))
        rt.hough.circles.detection.shrink(plane, factor, small[c])
    return Planes(tuple(small), np.dtype(np.float32))


def _centers(
    rt: Runtime,
    lines: Any,
    reach: tuple[float, float],
    shape: tuple[int, int],
    sides: tuple[int, int],
    least: float,
) -> tuple[np.ndarray, int]:
    """Return the likeliest centres, (K, 2) float32 in pixels, and the side of a cell."""
    cell = max(1, math.ceil(reach[1] / WIDEST))
    cells = tuple(-(-side // cell) for side in shape)
    steps = math.floor(reach[0] / cell), math.ceil(reach[1] / cell)
    votes, smooth = (rt.scratch(f"circles.{n}", (1, *cells)) for n in ("votes", "smooth"))
    rt.hough.circles.detection.vote_centers(
        lines, *steps, LINE_ONE / cell, *sides, votes.reshape(cells)
    )
    taps = rt.constant(SPREAD)
    rt.filters.linear.correlate_separable(votes, taps, taps, 1, Border.CONSTANT, 0.0, smooth)
    # Votes of a circle whose visible share is just `least`, with FOCUS votes per point.
    limit = FOCUS * least * WHOLE * reach[0] * float(SPREAD[2]) ** 2
    found, places = local_maxima(rt, smooth, (2, 2), limit)
    best = np.lexsort((*places.T[::-1], -found))[:CANDIDATES]
    return places[best, 1:].astype(np.float32) * np.float32(cell), cell


def _radii(
    rt: Runtime,
    lines: Any,
    centers: np.ndarray,
    reach: tuple[float, float],
    cell: int,
    sides: tuple[int, int],
    least: float,
) -> np.ndarray:
    """Return the likeliest circles around each centre, (K, 3) float32."""
    if not len(centers):
        return np.empty((0, 3), np.float32)
    begin, end = reach[0] - 2, reach[1] + 2
    bins = math.ceil(end - begin)
    counts = rt.scratch("circles.counts", (len(centers), bins), np.int32)
    rt.hough.circles.detection.vote_radii(
        lines,
        rt.send("circles.near", centers),
        begin,
        end,
        1.0,
        Aim(1.0 + cell, SLOPE, *sides),
        counts,
    )
    near = np.pad(rt.to_numpy(counts), ((0, 0), (1, 1)))
    near = near[:, :-2] + near[:, 1:-1] + near[:, 2:]
    radii = begin + 0.5 + np.arange(bins)
    share = near / (WHOLE * radii)
    around = np.pad(share, ((0, 0), (1, 1)))
    peak = (share > around[:, :-2]) & (share >= around[:, 2:]) & (share >= 0.5 * least)
    ranked = np.argsort(np.where(peak, -share, 0), axis=1, kind="stable")[:, :RADII]
    which = np.repeat(np.arange(len(centers)), ranked.shape[1])
    chosen = peak[which, ranked.ravel()]
    return np.column_stack((centers[which], radii[ranked.ravel()]))[chosen].astype(np.float32)


def _fitted(
    rt: Runtime, lines: Any, circles: np.ndarray, sides: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return circles fitted by least squares to the points near them, and their support.

    Let e be the distance of a point from the circle, and n the circle's normal there. After a small
    move (y, x) and a growth r, the distance is e - n (y, x) - r. This is a Gauss-Newton step.
    """
    support = np.zeros(len(circles), np.float32)
    if not len(circles):
        return circles, support
    sums = rt.scratch("circles.sums", (len(circles), 9), np.int64)
    arcs = rt.scratch("circles.arcs", (len(circles), ARCS), np.int32)
    exact = circles.astype(np.float64)
    aim = Aim(1.0, SLOPE, *sides)
    for step in range(FITS + 1):
        band = max(BAND, 4.0 - 1.5 * step)
        near = rt.send("circles.near", exact.astype(np.float32))
        rt.hough.circles.detection.support(lines, near, band, aim, sums, arcs)
        if step == FITS:
            # An edge has one point in each row or column of pixels that it crosses.
            whole = exact[:, 2:] * np.tile(_CROSSED, 8)
            seen = np.minimum(rt.to_numpy(arcs), whole).sum(axis=1) / whole.sum(axis=1)
            support = seen.astype(np.float32)
            break
        yy, yx, xx, y, x, n, ey, ex, e = (rt.to_numpy(sums) * _SCALES).T
        left = np.stack((yy, yx, y, yx, xx, x, y, x, n), axis=1).reshape(-1, 3, 3)
        left += 1e-3 * (n[:, None, None] + 1) * np.eye(3)  # damps what few points do not determine
        exact += np.linalg.solve(left, np.stack((ey, ex, e), axis=1)[..., None])[..., 0].clip(-2, 2)
        exact[:, 2] = np.maximum(exact[:, 2], 1.0)
    return exact.astype(np.float32), support


def distinct(shapes: np.ndarray, support: np.ndarray, apart: float) -> np.ndarray:
    """Return the indices of shapes whose centres are apart from those of all better shapes.

    The indices are in order of decreasing support. Rows of `shapes` (N, K) begin with row and
    column.
    """
    order = np.lexsort((*shapes.T[::-1], -support))
    kept = []
    # Each round takes out one shape at least.
    while len(order):
        best, order = order[0], order[1:]
        kept.append(best)
        gap = np.hypot(*(shapes[order, :2] - shapes[best, :2]).T)
        order = order[gap >= max(apart, 1e-6)]
    return np.array(kept, np.intp)
