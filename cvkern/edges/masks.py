"""Edges as a mask of pixels."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_choice, check_code, check_image, check_number, check_photograph
from cvkern._notices import may_look, warn
from cvkern._plans import planned_on_gpus
from cvkern._runtime import Runtime, runtime
from cvkern._strips import in_strips
from cvkern.edges.quantiles import SHARES, Thresholds, check_thresholds, find_limits, measures
from cvkern.edges.slopes import OPERATORS, Surroundings, find_slopes
from cvkern.filters.channels import Planes, planes_of
from cvkern.filters.gradients import without_channels
from cvkern.filters.linear import NO_SIGMA
from cvkern.kernels.codes.edges import Norm, Thinning
from cvkern.kernels.codes.filters import Border

SUPPRESSIONS = ("interpolated", "sectors")


class EdgeOptions(NamedTuple):
    """The checked options of edge detection."""

    sigma: float
    thresholds: Thresholds
    operator: str = "gaussian"
    norm: Norm = Norm.L2
    rule: Thinning = Thinning.INTERPOLATED
    around: Surroundings = Surroundings(Border.REFLECT, 0.0)
    batch_axis: int | None = None


@planned_on_gpus
@in_strips
def canny(
    image: Any,
    sigma: float = 1.0,
    low_threshold: float | None = None,
    high_threshold: float | None = None,
    mask: Any = None,
    use_quantiles: bool = False,
    *,
    operator: str = "sobel",
    suppression: str = "interpolated",
    norm: str = "l2",
    mode: str = "constant",
    cval: float = 0.0,
    batch_axis: int | None = None,
) -> Any:
    """Find edges by the Canny algorithm.

    A pixel is an edge candidate if its gradient is a maximum along its own direction and at least
    as long as `low_threshold`. A candidate is an edge if candidates connect it (by sides or
    corners) with one whose gradient is at least as long as `high_threshold`.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4, or a stack of them
        Any real dtype. Of a colour image, each pixel has the gradient of the channel where it is
        longest by `norm`, the first of equal ones; alpha is ignored.
    sigma : float, default 1.0
        Standard deviation of the Gaussian, in pixels. The operator 'gaussian' does not allow 0.
    low_threshold, high_threshold : float, optional
        Thresholds on the length of the gradient, in the units of Sobel's kernels applied to
        `image`: 8 times a slope per pixel. By default 10 % and 20 % of the dtype's range, which
        is 1 for floating-point images.
    mask : array of the result's shape, optional
        Pixels where it is 0 are ignored: a pixel can be an edge only if the mask is nonzero there
        and at all neighbours.
    use_quantiles : bool, default False
        Take the thresholds as quantiles, in [0, 1], of the gradient lengths of each image.
    operator : {'sobel', 'scharr', 'gaussian'}, default 'sobel'
        'sobel' and 'scharr' apply their kernels after the Gaussian; 'gaussian' applies derivatives
        of the Gaussian, which favour no direction. All use the units of Sobel's kernels.
    suppression : {'interpolated', 'sectors'}, default 'interpolated'
        The gradient lengths that a maximum is compared with: 'interpolated' interpolates between
        the neighbours along the gradient; 'sectors' takes the neighbours in the nearest of four
        directions, as OpenCV does. See the notes.
    norm : {'l1', 'l2'}, default 'l2'
        Length of the gradient: ``|dx| + |dy|`` or ``sqrt(dx^2 + dy^2)``.
    mode : {'reflect', 'constant', 'nearest', 'mirror', 'wrap'}, default 'constant'
        How the Gaussian continues the image outside. With 'constant', as with `mask`, the smoothed
        image is divided by a smoothed image of ones, so that no edge appears along the border.
    cval : float, default 0.0
        Value outside the image when `mode` is 'constant', in the units of `image`.
    batch_axis : {0}, optional
        Axis of the images in a stack, (N, H, W) or (N, H, W, 3 or 4). On a GPU each step takes all
        images in one launch.

    Returns
    -------
    array of shape (H, W), or (N, H, W) of a stack, bool

    Raises
    ------
    TypeError
        If `image` or `mask` does not hold real numbers.
    ValueError
        If `image` is empty or of another shape, `mask` is not of the result's shape, `sigma` is
        negative or not finite (or 0 with 'gaussian'), a threshold is negative (or above 1 as a
        quantile), `low_threshold` is above `high_threshold`, only `low_threshold` is given with a
        `sigma` above 16, or an option is unknown.

    Warns
    -----
    UserWarning
        If a NumPy image, or stack, on the CPU has no gradient as long as `high_threshold`.

    Notes
    -----
    By default the edges are those of :func:`skimage.feature.canny`, for images of unsigned integers
    and floating-point numbers. A pixel may differ if the rounding of float32 makes or breaks a tie
    of two lengths. scikit-image counts `cval` in units of the dtype's range. As in scikit-image,
    two adjacent pixels with equal gradients are both edges, and the outermost rows and columns
    have no edges.

    ``canny(x, 0, low, high, suppression="sectors", norm=norm, mode="nearest")`` of a uint8 image
    equals ``cv2.Canny(x, low, high, L2gradient=norm == "l2")`` in every pixel, of a colour image
    too, whatever the order of its channels. With 'sectors',
    lengths must exceed the thresholds, and the 3 x 3 kernels continue the image as `mode` says.

    With the operator 'gaussian', too, lengths must exceed the thresholds; the first of two equal
    pixels is the edge; the outermost pixels may be edges.

    Edges of integer images are the same on every device and kernel set.

    References
    ----------
    .. [1] J. Canny, "A computational approach to edge detection", IEEE PAMI 8(6), 1986.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> square = np.zeros((9, 9))
    >>> square[3:6, 3:6] = 1
    >>> int(cvkern.canny(square, 0.5).sum())
    8
    """
    image, options = canny_options(
        image, sigma, low_threshold, high_threshold, mask, use_quantiles,
        operator=operator, suppression=suppression, norm=norm, mode=mode, cval=cval,
        batch_axis=batch_axis,
    )  # fmt: skip
    rt = runtime(image, options.around.mask)
    edges = rt.empty(without_channels(image, batch_axis), bool)
    find_edges(rt, image, options, rt.adopt(edges, bool))
    return rt.release(edges)


def canny_options(
    image: Any,
    sigma: float,
    low_threshold: float | None,
    high_threshold: float | None,
    mask: Any,
    use_quantiles: bool,
    *,
    operator: str,
    suppression: str,
    norm: str,
    mode: str,
    cval: float,
    batch_axis: int | None = None,
) -> tuple[Any, EdgeOptions]:
    """Check the arguments of :func:`canny`, which has the defaults."""
    image = check_photograph(image, batch_axis=batch_axis)
    check_choice(operator, OPERATORS, "operator")
    check_choice(suppression, SUPPRESSIONS, "suppression")
    border = check_code(mode, Border, "mode")
    length = check_code(norm, Norm, "norm")
    cval = check_number(cval, "cval")
    sigma = check_number(sigma, "sigma", low=0)
    if mask is not None:
        shape = without_channels(image, batch_axis)
        mask = check_image(mask, ndim=(len(shape),), name="mask")
        if tuple(mask.shape) != shape:
            raise ValueError(
                f"mask must have the shape of the image, {shape}, got {tuple(mask.shape)}"
            )
    dtype = library(image).dtype(image)
    thresholds = check_thresholds(low_threshold, high_threshold, use_quantiles, dtype, sigma)
    rule = Thinning.SECTORS
    if suppression == "interpolated":
        rule = Thinning.INTERPOLATED if operator == "gaussian" else Thinning.FRAMED
    around = Surroundings(border, cval, mask)
    return image, EdgeOptions(sigma, thresholds, operator, length, rule, around, batch_axis)


def photograph_options(
    image: Any,
    sigma: float,
    low: float | None,
    high: float | None,
    use_quantiles: bool = False,
    *,
    automatic: tuple[float, float] | None = SHARES,
) -> EdgeOptions:
    """Check the options of functions that start from a photograph's edges.

    These functions use derivatives of the Gaussian. Without thresholds, they use the `automatic`
    quantiles of the image, if there are any.
    """
    sigma = check_number(sigma, "sigma", low=0)
    dtype = library(image).dtype(image)
    return EdgeOptions(
        sigma, check_thresholds(low, high, use_quantiles, dtype, sigma, automatic=automatic)
    )


def find_edges(rt: Runtime, image: Any, options: EdgeOptions, mask: Any) -> tuple[Any, Any]:
    """Fill the kernel array `mask`; return dy and dx, or None twice if they were not stored.

    `image` is the caller's, or `Planes` of it.
    """
    states = rt.scratch("canny.states", tuple(mask.shape), np.uint8)
    slopes = find_states(rt, image, options, states)
    rt.edges.masks.hysteresis(states, mask)
    _warn_of_none(rt, image, options, mask)
    return slopes


def find_states(rt: Runtime, image: Any, options: EdgeOptions, states: Any) -> tuple[Any, Any]:
    """Fill the kernel array `states` with codes of `Edge`; return slopes as `find_edges` does."""
    sigma, thresholds, operator, norm, rule, around, batch_axis = options
    shape = tuple(states.shape)
    slopes: tuple[Any, Any] = (None, None)
    strict = rule != Thinning.FRAMED
    sectors = rule == Thinning.SECTORS
    exact = sectors and sigma <= NO_SIGMA and _is_exact(image, options)
    if exact and tuple(image.shape) == shape and not isinstance(image, Planes):
        low, high = _integral(measures(thresholds, norm))
        src = rt.adopt(image, np.uint8)
        rt.edges.masks.thin_sobel(src, around.border, around.cval, norm, low, high, states)
    else:
        slopes = rt.scratch("canny.dy", shape), rt.scratch("canny.dx", shape)
        bare = sectors and around.mask is None
        planes = planes_of(rt, image, batch_axis=batch_axis)
        find_slopes(rt, planes, sigma, operator, around, bare, norm, *slopes)
        if exact:
            limits = rt.constant(np.array(_integral(measures(thresholds, norm)), np.float32))
        else:
            limits = find_limits(rt, *slopes, norm, thresholds, strict)
        rt.edges.masks.thin(*slopes, norm, rule, limits, states)
    if around.mask is not None:
        rt.edges.slopes.confine(rt.adopt(around.mask, bool), states)
    return slopes


def _is_exact(image: Any, options: EdgeOptions) -> bool:
    """Tell whether Sobel's sums of this image are exact, whatever their order."""
    border, cval, mask = options.around
    integral = border != Border.CONSTANT or cval in range(256)
    plain = options.operator == "sobel" and mask is None and not options.thresholds.quantiles
    return plain and integral and _dtype(image) == np.uint8


def _dtype(image: Any) -> np.dtype:
    return image.dtype if isinstance(image, Planes) else library(image).dtype(image)


def _integral(limits: np.ndarray) -> list[float]:
    """Return limits in float32 that give integers the same result as the given limits.

    An integer exceeds a limit exactly when it exceeds the limit's floor. Float32 holds floors
    exactly up to 2^24, and no Sobel measure of a uint8 image is larger.
    """
    return [float(min(math.floor(t) if math.isfinite(t) else 2**24, 2**24)) for t in limits]


def _warn_of_none(rt: Runtime, image: Any, options: EdgeOptions, mask: Any) -> None:
    """Warn if the thresholds lie above all gradients; only where the check need not wait."""
    thresholds = options.thresholds
    if not may_look(rt) or thresholds.quantiles or thresholds.high <= 0 or rt.to_numpy(mask).any():
        return
    shape = tuple(mask.shape)
    slopes = rt.scratch("canny.dy", shape), rt.scratch("canny.dx", shape)
    bare = options.rule == Thinning.SECTORS and options.around.mask is None
    given = options.sigma, options.operator, options.around, bare, options.norm
    find_slopes(rt, planes_of(rt, image, batch_axis=options.batch_axis), *given, *slopes)
    y, x = (np.nan_to_num(rt.to_numpy(a), posinf=0, neginf=0).astype(np.float64) for a in slopes)
    most = float((np.hypot(y, x) if options.norm == Norm.L2 else np.abs(y) + np.abs(x)).max())
    if 0 < most < thresholds.high:
        warn(
            f"no edge was found: the longest gradient of the image is {most:.4g}, below "
            f"high_threshold {thresholds.high:.4g}: lower it"
        )
