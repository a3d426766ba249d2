"""Thresholds of edges, given or computed from the image."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_flag, check_number
from cvkern._runtime import Runtime
from cvkern.edges.slopes import full_range
from cvkern.kernels.codes.edges import Norm

# Quantiles chosen on 12 photographs with boundaries drawn by people, and on the same photographs at
# half size, with noise, darker, and as 12 bits in 16. The F-measure within 3 pixels is 0.55; with
# 10 % and 20 % of the dtype's range it is 0.48 (0 for 12 bits in 16).
SHARES = 0.7, 0.9
LINE_SHARES = 0.5, 0.7  # quantiles for votes for long lines, which tolerate clutter
FAINTEST = 0.02  # share of the largest gradient; smaller ones are rounding errors of flat images
LARGE_SIGMA = 16.0


class Thresholds(NamedTuple):
    """Two lengths of the gradient, or two quantiles of its length in the image."""

    low: float
    high: float
    quantiles: bool = False
    faintest: float = 0.0
    """The smallest allowed threshold, as a share of the largest gradient of the image."""


def check_thresholds(
    low: float | None,
    high: float | None,
    use_quantiles: bool,
    dtype: np.dtype,
    sigma: float,
    *,
    automatic: tuple[float, float] | None = None,
) -> Thresholds:
    """Check the thresholds and fill in their defaults.

    With `automatic` shares, these quantiles are the default if neither threshold is given. If one
    is given, the lower is half of the higher.
    """
    use_quantiles = check_flag(use_quantiles, "use_quantiles")
    if low is not None:
        low = check_number(low, "low_threshold", low=0, finite=False)
    if high is not None:
        high = check_number(high, "high_threshold", low=0, finite=False)
    if low is not None and high is None and not use_quantiles and sigma > LARGE_SIGMA:
        raise ValueError(
            f"high_threshold must be given beside low_threshold at a sigma above {LARGE_SIGMA:g}, "
            f"got sigma {sigma:g} and low_threshold {low:g}: sigma comes before the thresholds "
            "here, while cv2.Canny has no sigma"
        )
    given = low is not None or high is not None
    if automatic and not given and not use_quantiles:
        return Thresholds(*automatic, True, FAINTEST)
    defaults = (0.1, 0.2) if use_quantiles else (0.1 * full_range(dtype), 0.2 * full_range(dtype))
    if automatic and given and not use_quantiles:
        defaults = (0.5 * (high or 0.0), 2.0 * (low or 0.0))
    if low is None:
        low = defaults[0] if high is None else min(defaults[0], high)
    if high is None:
        high = max(defaults[1], low)
    if use_quantiles and high > 1:
        raise ValueError(f"high_threshold must be a quantile in [0, 1], got {high:g}")
    if low > high:
        raise ValueError(f"low_threshold must be <= high_threshold, got {low:g} > {high:g}")
    return Thresholds(low, high, bool(use_quantiles))


def from_data(
    low: float | None, high: float | None, use_quantiles: bool
) -> tuple[float | None, float | None, bool]:
    """Fill in a command's thresholds: quantiles if none is given, else half or double of one."""
    if low is None and high is None:
        return *SHARES, True
    if not use_quantiles:
        low = 0.5 * high if low is None and high is not None else low
        high = 2 * low if high is None and low is not None else high
    return low, high, use_quantiles


def find_limits(
    rt: Runtime, dy: Any, dx: Any, norm: Norm, thresholds: Thresholds, strict: bool
) -> Any:
    """Return a kernel array of limits on the length of the gradient, or on its square.

    There are two for all images of a stack, or two for each if they are quantiles.

    A pixel must exceed a limit. If it may equal the threshold (not `strict`), the limit is the next
    smaller float. A quantile between two order statistics separates pixels as either of them does,
    so no interpolation is needed.
    """
    if not thresholds.quantiles:
        values = measures(thresholds, norm)
        if not strict:
            values = np.nextafter(values, np.float32(0))
        return rt.constant(values)
    ranks = ranks_of(thresholds, math.prod(dy.shape[-2:]), strict)
    images = 1 if len(dy.shape) == 2 else dy.shape[0]
    limits = rt.scratch("edges.limits", (2 * images,))
    chosen = rt.constant(np.array(ranks, np.int32))
    rt.edges.quantiles.find_limits(dy, dx, norm, chosen, strict, thresholds.faintest, limits)
    return limits


def ranks_of(thresholds: Thresholds, count: int, strict: bool) -> list[int]:
    """Return the order statistics of `count` lengths that two quantiles stand for."""
    nearest = math.floor if strict else math.ceil
    # Round, so that quantiles in hundredths hit order statistics exactly, as in scikit-image.
    return [nearest(round(q * (count - 1), 9)) for q in (thresholds.low, thresholds.high)]


def measures(thresholds: Thresholds, norm: Norm) -> np.ndarray:
    """Convert thresholds on a length to thresholds on the value that kernels compare, float32."""
    power = 1 if norm == Norm.L1 else 2
    with np.errstate(over="ignore"):
        return (np.array([thresholds.low, thresholds.high], np.float64) ** power).astype(np.float32)
