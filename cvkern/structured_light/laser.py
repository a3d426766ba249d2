"""Detection of laser lines in photographs, to a fraction of a pixel."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_choice, check_image, check_integer, check_number, check_positive
from cvkern._notices import may_look, warn
from cvkern._runtime import refuse_capture, runtime
from cvkern.filters.linear import gaussian_taps
from cvkern.structured_light._frames import carried_as, share_of_brightest

METHODS = ("peak", "center_of_mass", "steger")
SHARE = 0.2  # least strength of a line, as a share of the strongest one
STRONGEST = 0.95  # quantile of the strengths
MOST_SIGMA = 32.0


class LaserLines(NamedTuple):
    """Positions of a laser line, one in each column (axis 0) or row (axis 1) of a frame."""

    positions: Any
    """Row (axis 0) or column (axis 1), (lines,) or (N, lines) float32; NaN where no line is."""
    strengths: Any
    """Strength of the line there, of the same shape, in values of the frames."""


def detect_laser_lines(
    frames: Any,
    *,
    axis: int = 0,
    method: str = "steger",
    sigma: float = 2.0,
    threshold: float | None = None,
) -> LaserLines:
    """Find where a bright line crosses each column or row.

    Parameters
    ----------
    frames : array of shape (H, W) or (N, H, W)
        One frame or a stack; any real dtype.
    axis : {0, 1}, default 0
        0 finds a row in each column, for a line from left to right. 1 finds a column in each row.
    method : {'steger', 'center_of_mass', 'peak'}, default 'steger'
        `steger` finds the ridge of the frame smoothed by a Gaussian: the most accurate method, also
        for slanted lines. `center_of_mass` takes the centroid of a window of 3 `sigma` to either
        side, and suits saturated lines. `peak` fits a parabola through the brightest value and its
        neighbours; several equal values, as of a saturated line, count as one in their middle.
    sigma : float, default 2.0
        Standard deviation of the line's profile, pixels, in [0.5, 32].
    threshold : float, optional
        Positions of less strength are NaN. By default a fifth of the 95 % quantile of the
        strengths.

    Returns
    -------
    LaserLines
        Named tuple of `positions` and `strengths`, (W,) or (N, W) for axis 0, (H,) or (N, H) for
        axis 1, float32. The strength is the height of the line. For `steger` it is the height of a
        Gaussian profile of this `sigma` with the same second derivative. For `center_of_mass` it is
        the brightest minus the darkest value of the window, for `peak` the brightest value.

    Raises
    ------
    TypeError
        If `frames` does not hold real numbers, or a number is not one.
    ValueError
        If `frames` is empty or neither 2-D nor 3-D, or an argument is out of range.

    Notes
    -----
    The search begins at the brightest window of about `sigma` to either side; among equal windows
    the first wins. A column or row therefore has at most one position. For noise of standard
    deviation s and a line of height A, the standard deviation of a position is at least
    ``s sqrt(2 sigma / sqrt(pi)) / A`` if each column is processed alone. `steger` also averages
    along the line, and is below that bound. Results are equal bit for bit on all devices.

    References
    ----------
    .. [1] C. Steger, "An unbiased detector of curvilinear structures", IEEE Transactions on Pattern
       Analysis and Machine Intelligence 20, 1998.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> rows = np.arange(20.0)[:, None] - np.array([7.25, 7.5, 7.75])
    >>> frame = 200 * np.exp(-(rows**2) / 8)
    >>> cvkern.detect_laser_lines(frame, method="center_of_mass").positions.round(2)
    array([7.25, 7.5 , 7.75], dtype=float32)
    """
    frames = check_image(frames, ndim=(2, 3), name="frames")
    axis = check_integer(axis, "axis", 0, 1)
    method = check_choice(method, METHODS, "method")
    sigma = check_number(check_positive(sigma, "sigma"), "sigma", low=0.5)
    if sigma > MOST_SIGMA:
        raise ValueError(f"sigma must be in [0.5, {MOST_SIGMA:g}], got {sigma:g}")
    if threshold is None:
        refuse_capture("detect_laser_lines without a threshold")
    else:
        threshold = check_number(threshold, "threshold", low=0)
    stack = (1, *frames.shape) if len(frames.shape) == 2 else tuple(frames.shape)
    shape = stack[0], stack[2 - axis]
    rt, dtype = runtime(frames), library(frames).dtype(frames)
    seen = rt.adopt(frames, carried_as(dtype), stack)
    outer = shape[1:] if len(frames.shape) == 2 else shape
    result = LaserLines(rt.empty(outer), rt.empty(outer))
    positions, strengths = (rt.adopt(a, np.float32, shape) for a in result)
    places = rt.scratch("laser.places", shape, np.int32)
    laser = rt.structured_light.laser
    laser.find(seen, axis, 0 if method == "peak" else round(sigma), places)
    if method == "peak":
        laser.peaks(seen, axis, places, positions, strengths)
    elif method == "center_of_mass":
        laser.centroids(seen, axis, places, math.ceil(3 * sigma), positions, strengths)
    else:
        taps = rt.constant(np.stack([gaussian_taps(sigma, order) for order in range(3)]))
        # Second derivative at the ridge of a smoothed Gaussian line of height 1 and this sigma.
        bend = 1 / (2 * math.sqrt(2) * sigma**2)
        curve = 1 / (2 * sigma**2)
        laser.ridges(seen, axis, places, taps, 1 / bend, curve, positions, strengths)
    if threshold is None:
        threshold = share_of_brightest(rt.to_numpy(strengths), STRONGEST, SHARE)
    elif threshold > 0 and may_look(rt):
        most = float(np.fmax.reduce(rt.to_numpy(strengths), axis=None, initial=0.0))
        if 0 < most < threshold:
            warn(f"no line was found: the strongest is {most:.4g}, below threshold {threshold:.4g}")
    laser.select(strengths, threshold, positions)
    return LaserLines(*(rt.release(a) for a in result))
