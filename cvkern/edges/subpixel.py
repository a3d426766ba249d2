"""Edge points with sub-pixel positions."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_code, check_number, check_photograph
from cvkern._runtime import Runtime, runtime
from cvkern.edges.masks import EdgeOptions, find_edges, photograph_options
from cvkern.edges.slopes import Surroundings
from cvkern.filters.gradients import without_channels
from cvkern.kernels.codes.filters import Border


class SubpixelEdges(NamedTuple):
    """Points on the edges of an image, in raster order of their pixels."""

    points: Any
    """Row and column, in pixels with integer centres, (N, 2) float32."""
    orientation: Any
    """Direction of the gradient, ``atan2(dy, dx)`` in radians, (N,) float32."""
    strength: Any
    """Length of the gradient at the pixel, in Sobel's units, (N,) float32."""


def subpixel_edges(
    image: Any,
    sigma: float = 1.0,
    low_threshold: float | None = None,
    high_threshold: float | None = None,
    *,
    use_quantiles: bool = False,
    mode: str = "reflect",
    cval: float = 0.0,
    batch_axis: int | None = None,
) -> Any:
    """Locate edges with sub-pixel accuracy.

    The pixels are those of :func:`canny` with the operator 'gaussian'. If the gradient's length at
    a pixel is a maximum along the axis nearest to the gradient, the point moves along that axis.
    It moves to the maximum of the Gaussian through the lengths at the pixel and its two neighbours.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4, or a stack of them
        Any real dtype; colour as in :func:`canny`.
    sigma : float, default 1.0
        Standard deviation of the Gaussian, in pixels; at least about 1 for accuracy.
    low_threshold, high_threshold, use_quantiles
        As in :func:`canny`.
    mode, cval
        As in :func:`gaussian`.
    batch_axis : {0}, optional
        Axis of the images in a stack, (N, H, W) or (N, H, W, 3 or 4). The result is then a list
        with one result for each image, because their lengths differ.

    Returns
    -------
    SubpixelEdges, or list of them
        Named tuple of `points` (N, 2), `orientation` (N,) and `strength` (N,), float32.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        As :func:`canny`.

    Notes
    -----
    The position is exact for a straight step under Gaussian blur, at every angle. The edge of a
    disc of radius r is found about ``sigma^2 / (2 r)`` too far inside, as with every method that
    looks for the steepest slope of a blurred image. A gradient longer than 1.8e19, whose square
    float32 cannot hold, is not an edge.

    References
    ----------
    .. [1] F. Devernay, "A non-maxima suppression method for edge detection with sub-pixel
       accuracy", INRIA RR-2724, 1995 (which fits a parabola to the lengths).

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> step = np.tile([0, 0, 0, 0, 0.25, 1, 1, 1, 1, 1], (5, 1))
    >>> cvkern.subpixel_edges(step, 1.5).points[:2].round(2)
    array([[0.  , 4.27],
           [1.  , 4.27]], dtype=float32)
    """
    image = check_photograph(image, batch_axis=batch_axis)
    around = Surroundings(check_code(mode, Border, "mode"), check_number(cval, "cval"))
    options = photograph_options(
        image, sigma, low_threshold, high_threshold, use_quantiles, automatic=None
    )
    rt = runtime(image)
    found = locate_edges(rt, image, options._replace(around=around, batch_axis=batch_axis))
    results = [SubpixelEdges(*(rt.release(a) for a in edges)) for edges in found]
    return results[0] if batch_axis is None else results


def locate_edges(rt: Runtime, image: Any, options: EdgeOptions) -> list[SubpixelEdges]:
    """Return the sub-pixel edges of each image as kernel arrays, not yet released to the caller.

    The host waits once for all images of a stack.
    """
    shape = without_channels(image, options.batch_axis)
    mask = rt.scratch("subpixel.mask", shape, bool)
    slopes = find_edges(rt, image, options, mask)
    counts = rt.scratch("subpixel.counts", shape[:-1], np.int32)
    whole = (*slopes, mask, counts)
    stack = range(shape[0]) if len(shape) > 2 else ()
    given = [tuple(a[n] for a in whole) for n in stack] or [whole]
    for dy, dx, edges, number in given:
        rt.edges.subpixel.count_edges(dy, dx, edges, number)
    ends = np.cumsum(rt.to_numpy(counts), axis=-1, dtype=np.int32)
    before = np.roll(ends, 1, axis=-1)
    before[..., 0] = 0
    starts = rt.send("subpixel.starts", before)
    found = []
    for n, total in enumerate(ends[..., -1:].ravel().tolist()):
        results = SubpixelEdges(rt.empty((total, 2)), rt.empty((total,)), rt.empty((total,)))
        if total:
            begin = starts[n] if len(shape) > 2 else starts
            views = [rt.adopt(a) for a in results]
            dy, dx, edges, _ = given[n]
            rt.edges.subpixel.gather_edges(dy, dx, edges, begin, *views)
        found.append(results)
    return found
