"""Edges as a mask of pixels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_choice, check_code, check_image, check_number
from cvkern._runtime import Runtime, runtime
from cvkern.filters.gradients import derivatives
from cvkern.filters.linear import NO_SIGMA
from cvkern.kernels.codes.edges import Norm, Thinning
from cvkern.kernels.codes.filters import Border

OPERATORS = ("gaussian", "sobel")
SOBEL_GAIN = 8.0  # of the integer kernel, against a derivative per pixel


def canny(
    image: Any,
    sigma: float = 1.0,
    low_threshold: float | None = None,
    high_threshold: float | None = None,
    *,
    use_quantiles: bool = False,
    operator: str = "gaussian",
    norm: str = "l2",
    mode: str = "reflect",
    cval: float = 0.0,
) -> Any:
    """Find edges by the Canny algorithm.

    A pixel is an edge where the gradient is a maximum along its own direction and longer than
    `low_threshold`, and where such pixels connect it (by sides or corners) with one longer than
    `high_threshold`.

    Parameters
    ----------
    image : array of shape (H, W)
        Any real dtype; colour is for :func:`cvkern.images.luma` to take out first.
    sigma : float, default 1.0
        Standard deviation of the Gaussian, in pixels; 0 only with the operator 'sobel'.
    low_threshold, high_threshold : float, optional
        On the gradient's length, in the units of the operator. By default 10 % and 20 % of the
        dtype's range (1 for floating-point images) with 'sobel', as scikit-image has it, and an
        eighth of that, Sobel's gain, with 'gaussian'.
    use_quantiles : bool, default False
        Take the thresholds as quantiles, in [0, 1], of the gradient lengths of this image.
    operator : {'gaussian', 'sobel'}, default 'gaussian'
        'gaussian': derivatives of the Gaussian, suppression between interpolated neighbours
        (Canny 1986). 'sobel': the integer Sobel kernels after the Gaussian, suppression in four
        sectors, as OpenCV does it.
    norm : {'l1', 'l2'}, default 'l2'
        Length of the gradient: ``|dx| + |dy|`` or ``sqrt(dx^2 + dy^2)``.
    mode, cval
        As in :func:`gaussian`.

    Returns
    -------
    array of shape (H, W), bool

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or not 2-D, `sigma` is negative or not finite (or 0 with 'gaussian'),
        a threshold is negative, above 1 where it is a quantile, or `low_threshold` is above
        `high_threshold`, or an option is unknown.

    Notes
    -----
    ``canny(x, 0, low, high, operator="sobel", norm=norm, mode="nearest")`` of a uint8 image equals
    ``cv2.Canny(x, low, high, L2gradient=norm == "l2")`` in every pixel. Edges of integer images
    are the same on every device and kernel set.

    References
    ----------
    .. [1] J. Canny, "A computational approach to edge detection", IEEE PAMI 8(6), 1986.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> square = np.zeros((7, 7))
    >>> square[2:5, 2:5] = 1
    >>> int(cvkern.canny(square, 0.5).sum())
    8
    """
    image = check_image(image)
    check_choice(operator, OPERATORS, "operator")
    rt = runtime(image)
    edges = rt.empty(tuple(image.shape), bool)
    find_edges(
        rt, image, sigma, low_threshold, high_threshold, use_quantiles, operator, norm, mode, cval,
        rt.adopt(edges, bool),
    )  # fmt: skip
    return rt.release(edges)


def find_edges(
    rt: Runtime,
    image: Any,
    sigma: float,
    low_threshold: float | None,
    high_threshold: float | None,
    use_quantiles: bool,
    operator: str,
    norm: str,
    mode: str,
    cval: float,
    mask: Any,
) -> tuple[Any, Any]:
    """Fill the kernel array `mask`; return dy and dx, which a uint8 image under Sobel has not."""
    border = check_code(mode, Border, "mode")
    length = check_code(norm, Norm, "norm")
    cval = check_number(cval, "cval")
    sigma = check_number(sigma, "sigma", low=0)
    dtype = library(image).dtype(image)
    low, high = edge_thresholds(low_threshold, high_threshold, use_quantiles, operator, dtype)
    shape = tuple(image.shape)
    states = rt.scratch("canny.states", shape, np.uint8)
    dy = dx = None
    # Sums of uint8 are exact in any order.
    exact = dtype == np.uint8 and (border != Border.CONSTANT or cval in range(256))
    if operator == "sobel" and sigma <= NO_SIGMA and exact and not use_quantiles:
        limits = _measures(low, high, length, integral=True)
        rt.edges.masks.thin_sobel(rt.adopt(image, np.uint8), border, cval, length, *limits, states)
    else:
        dy, dx = rt.scratch("canny.dy", shape), rt.scratch("canny.dx", shape)
        derivatives(rt, image, sigma, operator, mode, cval, dy, dx)
        if use_quantiles:
            low, high = _quantiles(rt, dy, dx, length, low, high)
        rule = Thinning.SECTORS if operator == "sobel" else Thinning.INTERPOLATED
        rt.edges.masks.thin(dy, dx, length, rule, *_measures(low, high, length), states)
    rt.edges.masks.hysteresis(states, mask)
    return dy, dx


def edge_thresholds(
    low: float | None, high: float | None, use_quantiles: bool, operator: str, dtype: np.dtype
) -> tuple[float, float]:
    """Return the thresholds, checked, with their defaults filled in."""
    full = 1.0
    if not use_quantiles:
        full = float(np.iinfo(dtype).max) if dtype.kind in "iu" else 1.0
        full /= SOBEL_GAIN if operator == "gaussian" else 1.0
    low = check_number(0.1 * full if low is None else low, "low_threshold", low=0, finite=False)
    high = check_number(
        max(0.2 * full, low) if high is None else high, "high_threshold", low=0, finite=False
    )
    if use_quantiles and high > 1:
        raise ValueError(f"high_threshold must be a quantile in [0, 1], got {high:g}")
    if low > high:
        raise ValueError(f"low_threshold must be <= high_threshold, got {low:g} > {high:g}")
    return low, high


def _measures(low: float, high: float, norm: Norm, integral: bool = False) -> tuple[float, float]:
    """Return the limits for what kernels compare: the length itself, or its square.

    An integer exceeds a limit exactly when it exceeds its floor, which float32 holds exactly up to
    2^24; no Sobel measure of a uint8 image is larger.
    """
    limits = [t if norm == Norm.L1 else t * t for t in (low, high)]
    if integral:
        limits = [min(math.floor(t) if math.isfinite(t) else 2**24, 2**24) for t in limits]
    return float(limits[0]), float(limits[1])


def _quantiles(
    rt: Runtime, dy: Any, dx: Any, norm: Norm, low: float, high: float
) -> tuple[float, float]:
    """Return two quantiles of the gradient lengths, found on the host."""
    y, x = rt.to_numpy(dy), rt.to_numpy(dx)
    length = np.abs(x) + np.abs(y) if norm == Norm.L1 else np.sqrt(x * x + y * y)
    low, high = np.quantile(length, [low, high])
    return float(low), float(high)
