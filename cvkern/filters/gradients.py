"""First derivatives of images.

Derivatives are float32 sums in a fixed order of operations, so they have the same bits on every
device, and so have all results computed from them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_choice, check_code, check_number, check_photograph
from cvkern._plans import planned
from cvkern._runtime import Runtime, runtime
from cvkern._strips import in_strips
from cvkern.filters.channels import longest_slopes, planes_of
from cvkern.filters.linear import NO_SIGMA, check_radius, frozen_taps, gaussian_taps
from cvkern.kernels.codes.filters import Border, Outside

OPERATORS = ("gaussian", "sobel", "scharr")

# Smoothing halves of the 3 x 3 operators; the other half is the difference (-1, 0, 1).
SMOOTH = {
    "sobel": frozen_taps([1, 2, 1]),
    "scharr": frozen_taps([3, 10, 3]),
    "prewitt": frozen_taps([1, 1, 1]),
}
DIFFERENCE = frozen_taps([-1, 0, 1])


class Gradient(NamedTuple):
    """First derivatives of an image, and their polar form."""

    dy: Any
    """Derivative down the rows, (H, W) float32."""
    dx: Any
    """Derivative along the columns, (H, W) float32."""
    magnitude: Any
    """``sqrt(dy^2 + dx^2)``, (H, W) float32."""
    orientation: Any
    """``atan2(dy, dx)``, radians in (-pi, pi], (H, W) float32."""


@planned
@in_strips
def gradient(
    image: Any,
    *,
    sigma: float = 1.0,
    operator: str = "gaussian",
    mode: str = "reflect",
    cval: float = 0.0,
    batch_axis: int | None = None,
) -> Gradient:
    """Differentiate an image.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4, or a stack of them
        Any real dtype. Of a colour image, each pixel has the gradient of the channel where it is
        longest, the first of equal ones; alpha is ignored.
    sigma : float, default 1.0
        Standard deviation of the Gaussian, in pixels. 0 does not smooth; the operator 'gaussian'
        does not allow it.
    operator : {'gaussian', 'sobel', 'scharr'}, default 'gaussian'
        'gaussian' convolves with the derivatives of the Gaussian, in units of `image` per pixel.
        'sobel' and 'scharr' smooth with the Gaussian, then apply the integer 3 x 3 kernels of
        :func:`cv2.Sobel` and :func:`cv2.Scharr`, with their gains of 8 and 32.
    mode, cval, batch_axis
        As in :func:`gaussian`.

    Returns
    -------
    Gradient
        Named tuple of `dy`, `dx`, `magnitude` and `orientation`, each (H, W) float32, or (N, H, W)
        of a stack.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or of another shape, `sigma` is negative or not finite, or 0 with the
        operator 'gaussian', or `operator` or `mode` is unknown.

    Examples
    --------
    >>> import cvkern
    >>> ramp = [[0, 1, 2, 3, 4]] * 3
    >>> g = cvkern.gradient(ramp, sigma=0, operator="sobel")
    >>> g.dx[1], g.orientation[1, 2]
    (array([4., 8., 8., 8., 4.], dtype=float32), np.float32(0.0))
    """
    image = check_photograph(image, batch_axis=batch_axis)
    rt = runtime(image)
    shape = without_channels(image, batch_axis)
    results = Gradient(*(rt.empty(shape) for _ in Gradient._fields))
    views = (rt.adopt(a) for a in results)
    derivatives(rt, image, sigma, operator, mode, cval, *views, batch_axis=batch_axis)
    return Gradient(*(rt.release(a) for a in results))


def derivatives(
    rt: Runtime,
    image: Any,
    sigma: float,
    operator: str,
    mode: str,
    cval: float,
    *outputs: Any,
    batch_axis: int | None = None,
) -> None:
    """Fill kernel arrays with the results of :func:`gradient`: dy and dx, or all four."""
    border = check_code(mode, Border, "mode")
    cval = check_number(cval, "cval")
    sigma = check_number(sigma, "sigma", low=0)
    check_radius(4 * sigma)
    check_choice(operator, OPERATORS, "operator")
    if operator == "gaussian" and sigma <= NO_SIGMA:
        raise ValueError(f"sigma must be > 0 with the operator 'gaussian', got {sigma:g}")
    planes = planes_of(rt, image, batch_axis=batch_axis)

    def fill(src: Any, *filled: Any) -> None:
        _differentiate_plane(rt, src, sigma, operator, border, cval, *filled)

    if len(planes.values) == 1:
        fill(planes.values[0], *outputs)
        return
    longest_slopes(rt, planes, fill, *outputs[:2])
    if len(outputs) > 2:
        rt.filters.gradients.polar(*outputs)


def _differentiate_plane(
    rt: Runtime,
    src: Any,
    sigma: float,
    operator: str,
    border: Border,
    cval: float,
    *outputs: Any,
) -> None:
    if operator == "gaussian":
        smooth, slope = gaussian_taps(sigma), gaussian_taps(sigma, 1)
    else:
        smooth, slope = SMOOTH[operator], DIFFERENCE
        if sigma > NO_SIGMA:
            shape = tuple(src.shape)
            planes = (1, *shape)[-3:]
            taps = rt.constant(gaussian_taps(sigma))
            blurred = rt.scratch("derivatives.blurred", planes)
            rt.filters.linear.correlate_separable(
                src.reshape(planes), taps, taps, 1, border, cval, blurred
            )
            src = blurred.reshape(shape)
    differentiate(rt, src, smooth, slope, border, cval, *outputs)


def differentiate(
    rt: Runtime,
    src: Any,
    smooth: np.ndarray,
    slope: np.ndarray,
    border: Border,
    cval: float,
    *outputs: Any,
) -> None:
    """Differentiate, with the image continued as `border` says; `cval` is outside on every side."""
    beside = [_weighted(cval, taps) if cval else 0.0 for taps in (smooth, slope)]
    family = rt.filters.gradients
    primitive: Any = family.differentiate if len(outputs) == 2 else family.differentiate_polar
    outside = Outside(border, cval, *beside)
    primitive(src, rt.constant(smooth), rt.constant(slope), outside, *outputs)


def _weighted(value: float, taps: np.ndarray) -> float:
    """Return the response of the taps to a constant, in the arithmetic of the kernels."""
    total = np.float32(0)
    for tap in taps:
        total += tap * np.float32(value)
    return float(total)


def without_channels(image: Any, batch_axis: int | None) -> tuple[int, ...]:
    """Return the shape of an image, or of a stack, without its channels."""
    return tuple(image.shape[: 2 if batch_axis is None else 3])
