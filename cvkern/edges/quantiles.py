"""Thresholds of edges: given, or taken from the image."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_number
from cvkern._runtime import Runtime
from cvkern.edges.slopes import full_range
from cvkern.kernels.codes.edges import Norm

# Chosen on 12 photographs with boundaries drawn by people, and on the same ones at half size, with
# noise, darker, and as 12 bits in 16: F within 3 pixels 0.55, against 0.48 (0 for the last) of 10 %
# and 20 % of the dtype's range.
SHARES = 0.7, 0.9
FAINT_SHARES = 0.5, 0.7  # for what clutter hardly disturbs, such as votes for long lines
FAINTEST = 0.02  # of the largest gradient: below are roundings, where an image is mostly flat
LARGE_SIGMA = 16.0


class Thresholds(NamedTuple):
    """Two lengths of the gradient, or two quantiles of its length in the image."""

    low: float
    high: float
    quantiles: bool = False
    faintest: float = 0.0
    """The least threshold, over the largest gradient of the image."""


def check_thresholds(
    low: float | None,
    high: float | None,
    use_quantiles: bool,
    dtype: np.dtype,
    sigma: float,
    *,
    automatic: tuple[float, float] | None = None,
) -> Thresholds:
    """Return the thresholds, checked, with their defaults filled in.

    With `automatic` shares they are these quantiles where neither is given; where one is, the lower
    is half of the higher.
    """
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
    if low is not None:
        low = check_number(low, "low_threshold", low=0, finite=False)
    if high is not None:
        high = check_number(high, "high_threshold", low=0, finite=False)
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
    """Fill in the thresholds of a command: quantiles if none is given, else half or double."""
    if low is None and high is None:
        return *SHARES, True
    if not use_quantiles:
        low = 0.5 * high if low is None and high is not None else low
        high = 2 * low if high is None and low is not None else high
    return low, high, use_quantiles


def find_limits(
    rt: Runtime, dy: Any, dx: Any, norm: Norm, thresholds: Thresholds, strict: bool
) -> Any:
    """Return the kernel array of what is compared with limits: a length, or its square.

    A pixel must exceed a limit; where it may equal a threshold (not `strict`), the limit is the
    float below. A quantile between two order statistics parts pixels as either of them does, so
    that no interpolation is needed.
    """
    if not thresholds.quantiles:
        values = measures(thresholds, norm)
        if not strict:
            values = np.nextafter(values, np.float32(0))
        return rt.constant(values)
    last = math.prod(dy.shape) - 1
    nearest = math.floor if strict else math.ceil
    # Quantiles in hundredths meet order statistics exactly, as they do in scikit-image.
    ranks = [nearest(round(q * last, 9)) for q in (thresholds.low, thresholds.high)]
    limits = rt.scratch("edges.limits", (2,))
    chosen = rt.constant(np.array(ranks, np.int32))
    rt.edges.quantiles.find_limits(dy, dx, norm, chosen, strict, thresholds.faintest, limits)
    return limits


def measures(thresholds: Thresholds, norm: Norm) -> np.ndarray:
    """Return thresholds on a length as those on what kernels compare, float32."""
    power = 1 if norm == Norm.L1 else 2
    with np.errstate(over="ignore"):
        return (np.array([thresholds.low, thresholds.high], np.float64) ** power).astype(np.float32)
