"""Each pixel compared with its surroundings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._checks import as_numbers, check_number
from cvkern._runtime import runtime
from cvkern.color.contrast import checked
from cvkern.filters import gaussian


def retinex(
    image: Any, sigma: float | Sequence[float] = (15.0, 80.0, 250.0), *, low: float = 1 / 255
) -> Any:
    """Compare each pixel with its surroundings at several scales (multi-scale retinex).

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C)
        uint8, uint16 or floats. Channels are treated alike, each by itself.
    sigma : float or sequence of float, default (15.0, 80.0, 250.0)
        Standard deviations of the surroundings in pixels, above 0.
    low : float, default 1 / 255
        What is added to both, as a share of white (1 in floats), above 0: it keeps noise in the
        dark small.

    Returns
    -------
    array of the same shape, float32
        Mean over the scales of the natural logarithm of the pixel over its surroundings: 0 where
        it is as bright as these.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If it is of another dtype or not finite, or a number is not above 0.

    Notes
    -----
    Surroundings are those of `gaussian`, with the image reflected outside. Negative values count as
    0. Logarithms agree between devices to rounding.

    References
    ----------
    .. [1] D. J. Jobson, Z. Rahman and G. A. Woodell, "A multiscale retinex for bridging the gap
       between color images and the human observation of scenes", IEEE Transactions on Image
       Processing 6, 1997.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> scene = np.full((8, 8), 0.2)
    >>> scene[4, 4] = 0.4
    >>> round(float(cvkern.retinex(scene, 2.0)[4, 4]), 2)
    0.65
    """
    image, most = checked(image)
    sigmas = np.atleast_1d(as_numbers(sigma, "sigma"))
    if sigmas.ndim != 1 or not sigmas.size or not (np.isfinite(sigmas).all() and sigmas.min() > 0):
        raise ValueError(f"sigma must be one or more numbers above 0, got {sigma}")
    low = check_number(low, "low")
    if low <= 0:
        raise ValueError(f"low must be above 0, got {low:g}")
    rt = runtime(image)
    shape = tuple(image.shape)
    flat = (int(np.prod(shape)),)
    result = rt.empty(shape)
    out = rt.adopt(result, np.float32, flat)
    rt.clear(out)
    for one in sigmas:
        smooth = gaussian(image, float(one), channel_axis=-1 if len(shape) == 3 else None)
        rt.color.surroundings.add_log_ratio(
            rt.adopt(image, np.float32, flat), rt.adopt(smooth, np.float32, flat),
            low * (most or 1), 1 / sigmas.size, out,
        )  # fmt: skip
    return rt.release(result)
