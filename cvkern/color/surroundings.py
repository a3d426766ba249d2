"""Each pixel compared with its surroundings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._checks import as_numbers, check_choice, check_number
from cvkern._runtime import Runtime, refuse_capture, runtime
from cvkern.color.contrast import checked
from cvkern.filters import gaussian
from cvkern.shading.integration import Solver

METHODS = ("surroundings", "gradients")
MOST_STEP = 88.0  # largest step of the logarithm in float32
TOLERANCE = 1e-5  # relative error of the solution of Poisson's equation


def retinex(
    image: Any,
    sigma: float | Sequence[float] = (15.0, 80.0, 250.0),
    *,
    method: str = "surroundings",
    low: float = 1 / 255,
    threshold: float = 0.05,
) -> Any:
    """Take slow changes out of an image, which are those of the light, and keep the paint's.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C)
        uint8, uint16 or floats. Channels are treated alike, each by itself.
    sigma : float or sequence of float, default (15.0, 80.0, 250.0)
        For 'surroundings': their standard deviations in pixels, above 0.
    method : {'surroundings', 'gradients'}, default 'surroundings'
        Compare each pixel with its surroundings at several scales (multi-scale retinex [1]_), or
        leave out small steps between neighbours and add the others up [2]_, [3]_.
    low : float, default 1 / 255
        What is added to both, as a share of white (1 in floats), above 0: it keeps noise in the
        dark small.
    threshold : float, default 0.05
        For 'gradients': natural logarithm of the ratio of neighbours up to which it counts as a
        change of light, 0 or more.

    Returns
    -------
    array of the same shape, float32
        Natural logarithms. Of surroundings, the mean over the scales of the pixel over these: 0
        where it is as bright. Of gradients, of the paint, with a mean of 0 in each channel.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If it is of another dtype or not finite, a number is out of range, or the method is
        unknown.

    Notes
    -----
    Surroundings are those of `gaussian`, with the image reflected outside. Negative values count as
    0. For gradients, the image whose steps differ least from those that were kept solves Poisson's
    equation; the solver is that of `integrate_normals`. Where light itself has edges, as of a
    shadow, it is taken for paint. Results agree between devices to rounding.

    References
    ----------
    .. [1] D. J. Jobson, Z. Rahman and G. A. Woodell, "A multiscale retinex for bridging the gap
       between color images and the human observation of scenes", IEEE Transactions on Image
       Processing 6, 1997.
    .. [2] B. K. P. Horn, "Determining lightness from an image", Computer Graphics and Image
       Processing 3, 1974.
    .. [3] J. M. Morel, A. B. Petro and C. Sbert, "A PDE formalization of retinex theory", IEEE
       Transactions on Image Processing 19, 2010.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> scene = np.full((8, 8), 0.2)
    >>> scene[4, 4] = 0.4
    >>> round(float(cvkern.retinex(scene, 2.0)[4, 4]), 2)
    0.65
    """
    image, most, _ = checked(image)
    sigmas = np.atleast_1d(as_numbers(sigma, "sigma"))
    if sigmas.ndim != 1 or not sigmas.size or not (np.isfinite(sigmas).all() and sigmas.min() > 0):
        raise ValueError(f"sigma must be one or more numbers above 0, got {sigma}")
    check_choice(method, METHODS, "method")
    low = check_number(low, "low")
    if low <= 0:
        raise ValueError(f"low must be above 0, got {low:g}")
    threshold = check_number(threshold, "threshold", low=0)
    low *= most or 1
    rt = runtime(image)
    result = rt.empty(tuple(image.shape))
    if method == "gradients":
        _add_steps(rt, image, low, threshold, result)
        return rt.release(result)
    flat = (int(np.prod(image.shape)),)
    out = rt.adopt(result, np.float32, flat)
    rt.clear(out)
    for one in sigmas:
        smooth = gaussian(image, float(one), channel_axis=-1 if len(image.shape) == 3 else None)
        rt.color.surroundings.add_log_ratio(
            rt.adopt(image, np.float32, flat), rt.adopt(smooth, np.float32, flat),
            low, 1 / sigmas.size, out,
        )  # fmt: skip
    return rt.release(result)


def _add_steps(rt: Runtime, image: Any, low: float, threshold: float, result: Any) -> None:
    """Fill the result with the image whose large steps are those of the logarithm of `image`."""
    refuse_capture("retinex by gradients")
    height, width = image.shape[:2]
    shape = (height, width, int(np.prod(image.shape[2:])))
    values, out = rt.adopt(image, np.float32, shape), rt.adopt(result, np.float32, shape)
    inside = rt.send("retinex.inside", np.ones((height, width), np.uint8))
    kernels = rt.color.surroundings
    for channel in range(shape[2]):
        solver = Solver(rt, inside, (height, width))
        ratio = math.exp(min(threshold, MOST_STEP))
        kernels.steps(values, channel, low, ratio, solver.weights, solver.rises)
        solver.solve(TOLERANCE)
        kernels.put(solver.z, float(rt.to_numpy(solver.z).mean()), channel, out)
