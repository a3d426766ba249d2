"""Exposures of one scene fused to a picture, without radiance."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_number
from cvkern._runtime import Runtime, runtime
from cvkern._whites import white_of
from cvkern.filters.linear import frozen_taps
from cvkern.kernels.codes.filters import Border
from cvkern.kernels.codes.raw import WELL
from cvkern.raw.exposures import stacked

LEAST_WHITE = 1e-30  # so that its inverse is a number of float32


def fuse_exposures(
    images: Any,
    *,
    contrast: float = 1.0,
    saturation: float = 1.0,
    exposure: float = 1.0,
    white: float | None = None,
) -> Any:
    """Fuse exposures of a scene to one picture in which all of it is well exposed.

    Parameters
    ----------
    images : array of shape (K, H, W) or (K, H, W, 3)
        Exposures, registered: uint8, uint16 or floating. NumPy also takes a sequence of images.
    contrast, saturation, exposure : float, default 1.0
        Exponents of the three measures that an image is weighted by; 0 leaves one out.
    white : float, optional
        The value of white. By default 255 for uint8 and 1 for floating images; for uint16, and
        floating images with a mean above 1, the smallest of 2^8 - 1, 2^10 - 1, 2^12 - 1 and so on
        that no value exceeds. A captured call knows only the dtype: its white is 65535 for uint16,
        and 1 for floating images.

    Returns
    -------
    array of shape (H, W) or (H, W, 3), float32
        The picture, in 0 to 1.

    Raises
    ------
    TypeError
        If `images` are of another dtype.
    ValueError
        If there are fewer than two images, shapes differ, there are not 3 channels, or an exponent
        is negative or `white` below 1e-30.

    See Also
    --------
    merge_exposures : Radiance, where the times of the exposures are known.

    Notes
    -----
    Images are weighted by the size of their Laplacian, the standard deviation of their colours, and
    how near values are to 0.5, and blended band by band [1]_. Bands may add up to more than there
    was: values within 0.05 of 0 and 1 and beyond are bent into the range, by exponentials. Floats
    are limited to black and white first, and NaN is black. Equal in every bit on all devices.

    References
    ----------
    .. [1] T. Mertens, J. Kautz and F. Van Reeth, "Exposure fusion", Pacific Graphics 2007.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> light = np.linspace(0, 1, 64) + np.zeros((48, 1))
    >>> images = [np.clip(light * t, 0, 1) for t in (0.5, 1.0, 2.0)]
    >>> fused = cvkern.fuse_exposures(images)
    >>> bool(fused.min() >= 0 and fused.max() <= 1)
    True
    """
    images, shape = stacked(images)
    if shape[3] not in (1, 3):
        raise ValueError(f"images must have 1 or 3 channels, got {shape[3]}")
    powers = [
        check_number(v, n, low=0)
        for v, n in ((contrast, "contrast"), (saturation, "saturation"), (exposure, "exposure"))
    ]
    white = None if white is None else check_number(white, "white", low=LEAST_WHITE)
    rt = runtime(images)
    dtype = library(images).dtype(images)
    if dtype not in (np.uint8, np.uint16) and dtype.kind != "f":
        raise TypeError(f"images must be uint8, uint16 or floating, got {dtype}")
    integral = dtype == np.uint8 and white is None
    frames = rt.adopt(images, np.uint8 if integral else np.float32, shape)
    white = white_of(images) if white is None else white
    if not integral and white != 1:
        frames = _scaled(rt, frames, white)
    scale = 1 / 255 if integral else 1.0
    # exp(-d / (2 WELL^2)) as a power of 2 of the squared distance d.
    powers[2] *= -math.log2(math.e) / (2 * WELL**2)
    count, height, width, channels = shape
    kernels = rt.raw.fusion
    weights = rt.scratch("fusion.weights", shape[:3])
    kernels.weigh(frames, scale, powers[0], powers[1], powers[2], weights)
    levels, sides, planes = [], [height, width], count * (channels + 1)
    for n in range(int(math.log2(min(sides)))):
        sides = [(side + 1) // 2 for side in sides]
        levels.append(rt.scratch(f"fusion.level{n}", (planes + channels, *sides)))
    if levels:
        kernels.begin(frames, scale, weights, levels[0])
        rt.raw.bands.reduce(levels, planes)
        kernels.blend(levels, channels)
    result = rt.empty(tuple(images.shape[1:]))
    out = rt.adopt(result, np.float32, shape[1:])
    coarse = levels[0] if levels else rt.scratch("fusion.none", (1, 1, 1))
    kernels.finish(frames, scale, weights, coarse, int(not levels), out)
    return rt.release(result)


def _scaled(rt: Runtime, frames: Any, white: float) -> Any:
    """Return frames whose white is 1."""
    scaled = rt.scratch("fusion.scaled", tuple(frames.shape))
    flat = (1, math.prod(frames.shape[:2]), math.prod(frames.shape[2:]))
    share, one = (rt.constant(frozen_taps(np.array([v]))) for v in (1 / white, 1.0))
    rt.filters.linear.correlate_separable(
        frames.reshape(flat), share, one, 1, Border.NEAREST, 0.0, scaled.reshape(flat)
    )
    return scaled
