"""Measures of the similarity of two pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import FLOAT32_MAX, check_image, check_positive

__all__ = ["psnr", "ssim"]

WINDOW, SIGMA = 11, 1.5  # pixels: side and standard deviation of the Gaussian weights of [1]
C1, C2 = 0.01**2, 0.03**2  # shares of the squared range; they keep quotients of flat parts finite


def psnr(image: Any, truth: Any, *, data_range: float | None = None) -> float:
    """Return the peak signal-to-noise ratio of two pictures.

    Parameters
    ----------
    image, truth : array of shape (H, W) or (H, W, C)
        Real numbers, one shape.
    data_range : float, optional
        The greatest value less the least one that a picture can have, > 0. By default 255 for
        pictures of uint8, 65535 for uint16, and 1 for bool and floats.

    Returns
    -------
    float
        ``10 log10(data_range^2 / mean squared error)``, decibels; infinite for equal pictures.

    Raises
    ------
    TypeError
        If a picture does not hold real numbers.
    ValueError
        If no `data_range` is given for pictures of other integers, or for integers and floats; if
        the shapes differ, a value is not finite, a picture is empty or has another rank, or
        `data_range` is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from cvkern.radiance import psnr
    >>> round(psnr(np.full((4, 4), 0.6), np.full((4, 4), 0.5)), 6)
    20.0
    """
    found, wanted, top = _pair(image, truth, data_range)
    error = float(((found - wanted) ** 2).mean())
    with np.errstate(divide="ignore"):  # equal pictures
        return float(20 * np.log10(top) - 10 * np.log10(error))


def ssim(image: Any, truth: Any, *, data_range: float | None = None) -> float:
    """Return the structural similarity of two pictures.

    Parameters
    ----------
    image, truth : array of shape (H, W) or (H, W, C)
        Real numbers, one shape, at least 11 x 11 pixels.
    data_range : float, optional
        The greatest value less the least one that a picture can have, > 0. By default 255 for
        pictures of uint8, 65535 for uint16, and 1 for bool and floats.

    Returns
    -------
    float
        In [-1, 1]; 1 for equal pictures. The mean over channels, and over the pixels that a whole
        window of 11 x 11 lies around, with Gaussian weights of 1.5 pixels.

    Raises
    ------
    TypeError
        If a picture does not hold real numbers.
    ValueError
        If no `data_range` is given for pictures of other integers, or for integers and floats; if
        the shapes differ, a value is not finite, a picture is smaller than the window or has
        another rank, or `data_range` is not positive.

    References
    ----------
    .. [1] Z. Wang, A. C. Bovik, H. R. Sheikh and E. P. Simoncelli, "Image quality assessment:
       from error visibility to structural similarity", IEEE Transactions on Image Processing
       13(4), 2004.

    Examples
    --------
    >>> import numpy as np
    >>> from cvkern.radiance import ssim
    >>> image = np.random.default_rng(0).random((16, 16))
    >>> ssim(image, image)
    1.0
    """
    from scipy.ndimage import correlate1d

    a, b, top = _pair(image, truth, data_range)
    if min(a.shape[:2]) < WINDOW:
        raise ValueError(f"image must have at least {WINDOW} x {WINDOW} pixels, got {a.shape}")
    reach = WINDOW // 2
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / SIGMA) ** 2)
    taps /= taps.sum()

    def mean(values: np.ndarray) -> np.ndarray:
        weighed = correlate1d(correlate1d(values, taps, axis=0), taps, axis=1)
        return weighed[reach:-reach, reach:-reach]

    mean_a, mean_b = mean(a), mean(b)
    var_a, var_b = mean(a * a) - mean_a**2, mean(b * b) - mean_b**2
    both = mean(a * b) - mean_a * mean_b
    least = float(np.finfo(np.float64).tiny)  # equal pictures without light are equal
    c1, c2 = max(C1 * top**2, least), max(C2 * top**2, least)
    light = (2 * mean_a * mean_b + c1) / (mean_a**2 + mean_b**2 + c1)
    return float((light * (2 * both + c2) / (var_a + var_b + c2)).mean())


def _pair(image: Any, truth: Any, data_range: float | None) -> tuple[np.ndarray, np.ndarray, float]:
    """Return both pictures in float64, and the range of their values."""
    image, truth = check_image(image, ndim=(2, 3)), check_image(truth, ndim=(2, 3), name="truth")
    if data_range is None:
        ranges = {_range(library(picture).dtype(picture)) for picture in (image, truth)}
        if len(ranges) > 1 or None in ranges:
            kinds = [str(library(picture).dtype(picture)) for picture in (image, truth)]
            raise ValueError(f"data_range must be given for {' and '.join(kinds)}, got None")
        (data_range,) = ranges
    top = check_positive(data_range, "data_range")
    found, wanted = np.asarray(image, np.float64), np.asarray(truth, np.float64)
    for name, values in (("image", found), ("truth", wanted)):
        if not (np.abs(values) <= FLOAT32_MAX).all():
            raise ValueError(f"{name} must be finite in float32, got values that are not")
    if found.shape != wanted.shape:
        raise ValueError(f"image must have the shape of truth, {wanted.shape}, got {found.shape}")
    return found, wanted, top


def _range(dtype: np.dtype) -> float | None:
    """Return the range of pictures of a dtype, if all such pictures have the same."""
    if dtype.kind in "fb":
        return 1.0
    return float(np.iinfo(dtype).max) if dtype.kind == "u" and dtype.itemsize <= 2 else None
