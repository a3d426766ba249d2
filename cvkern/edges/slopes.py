"""The derivatives for edge detection, in the units of Sobel's kernels.

Masked pixels, and those outside a constant border, do not darken their neighbours: the smoothed
image is divided by an image of ones that was smoothed in the same way, as in scikit-image.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.filters.channels import longest_slopes, planes_of
from cvkern.filters.gradients import DIFFERENCE, SMOOTH, differentiate
from cvkern.filters.linear import NO_SIGMA, check_radius, frozen_taps, gaussian_taps
from cvkern.kernels.codes.edges import Norm
from cvkern.kernels.codes.filters import Border

OPERATORS = ("sobel", "scharr", "gaussian")
SOBEL_GAIN = 8.0  # Sobel's integer kernel over the derivative per pixel
_SCHARR_GAIN = 4.0  # Scharr's integer kernel over Sobel's


class Surroundings(NamedTuple):
    """The values outside the image, and the pixels to ignore."""

    border: Border
    cval: float
    mask: Any = None
    """Array of the image's shape, 0 where a pixel is ignored."""

    @property
    def partial(self) -> bool:
        """Whether a window may contain ignored pixels."""
        return self.mask is not None or self.border == Border.CONSTANT


def find_slopes(
    rt: Runtime,
    image: Any,
    sigma: float,
    operator: str,
    around: Surroundings,
    bare: bool,
    norm: Norm,
    dy: Any,
    dx: Any,
) -> None:
    """Fill the kernel arrays dy and dx, (H, W), or (N, H, W) of a stack that `planes_of` read.

    `bare` uses the border values plainly, as OpenCV does.

    A colour image has the gradient of the channel where it is longest by `norm`.
    """
    check_radius(4 * sigma)
    if operator == "gaussian" and sigma <= NO_SIGMA:
        raise ValueError(f"sigma must be > 0 with the operator 'gaussian', got {sigma:g}")
    planes = planes_of(rt, image)
    options = planes.dtype, sigma, operator, around, bare

    def fill(plane: Any, down: Any, along: Any) -> None:
        _differentiate_plane(rt, plane, *options, down, along)

    longest_slopes(rt, planes, fill, dy, dx, norm)


def _differentiate_plane(
    rt: Runtime,
    plane: Any,
    dtype: np.dtype,
    sigma: float,
    operator: str,
    around: Surroundings,
    bare: bool,
    dy: Any,
    dx: Any,
) -> None:
    """Fill dy and dx of one channel of an image of `dtype`."""
    if operator != "gaussian":
        gain = _SCHARR_GAIN if operator == "scharr" else 1.0
        smooth = _scaled(SMOOTH[operator].tobytes(), 1 / gain)
        src = _blurred(rt, plane, dtype, sigma, around, bare)
        last = (around.border, around.cval) if bare else (Border.REFLECT, 0.0)
        differentiate(rt, src, smooth, DIFFERENCE, *last, dy, dx)
        return
    taps = gaussian_taps(sigma)
    slope = _scaled(gaussian_taps(sigma, 1).tobytes(), SOBEL_GAIN)
    if bare or not around.partial:
        differentiate(rt, plane, taps, slope, around.border, around.cval, dy, dx)
        return
    shape = tuple(plane.shape)
    covered, weight = _covered(rt, plane, around)
    smooth, share = (rt.scratch(f"slopes.{name}", shape) for name in ("smooth", "share"))
    share_dy, share_dx = (rt.scratch(f"slopes.{name}", shape) for name in ("share_dy", "share_dx"))
    cval = around.cval / full_range(dtype)
    for src, beyond, blurred, down, along in (
        (covered, around.cval, smooth, dy, dx),
        (weight, cval, share, share_dy, share_dx),
    ):
        _smooth(rt, src, taps, around.border, beyond, blurred)
        differentiate(rt, src, taps, slope, around.border, beyond, down, along)
    rt.edges.slopes.recover_slopes(smooth, share, share_dy, share_dx, _least(dtype), dy, dx)


def full_range(dtype: np.dtype) -> float:
    """Return the largest value of an integer dtype, and 1 for any other."""
    return float(np.iinfo(dtype).max) if dtype.kind in "iu" else 1.0


def _blurred(
    rt: Runtime, plane: Any, dtype: np.dtype, sigma: float, around: Surroundings, bare: bool
) -> Any:
    """Return the smoothed plane of an image of `dtype`."""
    shape = tuple(plane.shape)
    if around.mask is not None:
        src, weight = _covered(rt, plane, around)
    else:
        src, weight = plane, None
    if sigma <= NO_SIGMA:
        return src
    taps = gaussian_taps(sigma)
    blurred = rt.scratch("slopes.smooth", shape)
    _smooth(rt, src, taps, around.border, around.cval, blurred)
    if bare or not around.partial:
        return blurred
    cval = around.cval / full_range(dtype)
    if weight is not None:
        share = rt.scratch("slopes.share", shape)
        _smooth(rt, weight, taps, around.border, cval, share)
        rt.edges.slopes.recover(share, _least(dtype), blurred)
        return blurred
    rows, columns = _seen(shape[-2], sigma, cval), _seen(shape[-1], sigma, 0.0)
    reach = min(len(taps) // 2, max(shape[-2:]))
    rt.edges.slopes.recover_frame(rt.constant(rows), rt.constant(columns), cval, reach, blurred)
    return blurred


def _smooth(rt: Runtime, src: Any, taps: np.ndarray, border: Border, cval: float, dst: Any) -> None:
    planes = (1, *src.shape)[-3:]
    weights = rt.constant(taps)
    rt.filters.linear.correlate_separable(
        src.reshape(planes), weights, weights, 1, border, cval, dst.reshape(planes)
    )


def _covered(rt: Runtime, plane: Any, around: Surroundings) -> tuple[Any, Any]:
    """Return two arrays: the plane with 0 where it is masked, and 1 where it is not masked."""
    shape = tuple(plane.shape)
    mask = None if around.mask is None else rt.adopt(around.mask, bool)
    covered, weight = (rt.scratch(f"slopes.{name}", shape) for name in ("covered", "weight"))
    rt.edges.slopes.cover(plane, mask, covered, weight)
    return covered, weight


def _least(dtype: np.dtype) -> float:
    """Return the epsilon that scikit-image adds to weights, of the dtype it works in."""
    return float(np.finfo(dtype if dtype in (np.float32, np.float64) else np.float64).eps)


@lru_cache(maxsize=64)
def _seen(side: int, sigma: float, cval: float) -> np.ndarray:
    """Return ones smoothed along one axis, with `cval` outside; exactly 1 away from the ends."""
    taps = gaussian_taps(sigma).astype(np.float64)
    reach = len(taps) // 2
    total = np.concatenate(([0.0], np.cumsum(taps)))
    at = np.arange(side)
    begin = np.clip(reach - at, 0, len(taps))
    end = np.clip(reach - at + side, 0, len(taps))
    share = np.where((begin == 0) & (end == len(taps)), 1.0, total[end] - total[begin])
    return frozen_taps(share + cval * (1 - share))


@lru_cache(maxsize=64)
def _scaled(taps: bytes, gain: float) -> np.ndarray:
    """Return float32 taps times a power of two, which is exact."""
    return frozen_taps(np.frombuffer(taps, np.float32) * np.float32(gain))
