"""A threshold between dark and bright pixels, from the image's histogram."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_image, check_integer
from cvkern._runtime import Runtime, runtime

_WIDEST = 1 << 16  # bins of a histogram of integers, one for each value


def threshold_otsu(image: Any, nbins: int = 256) -> Any:
    """Find the threshold that separates two classes of pixels best.

    Of all thresholds, the variance between the means of the pixels at most as bright and those
    brighter is largest.

    Parameters
    ----------
    image : array of shape (H, W)
        Any real dtype; finite.
    nbins : int, default 256
        Bins between the smallest and the largest value of floats. Of integers, each value has its
        own.

    Returns
    -------
    number
        A NumPy scalar of the dtype of integers, or else the centre of a bin, float64. Pixels above
        it are bright.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty, not 2-D or not finite, its integers lie more than 65535 apart, or
        `nbins` is below 2.

    Notes
    -----
    Equal to :func:`skimage.filters.threshold_otsu`, and to `cv2.threshold` with `THRESH_OTSU` of a
    uint8 image. Of equal variances, the smallest threshold wins. The histogram of uint8 and
    uint16 is counted where the image is, others on the host: an array on a GPU is copied.

    References
    ----------
    .. [1] N. Otsu, "A threshold selection method from gray-level histograms", IEEE Transactions on
       Systems, Man, and Cybernetics 9(1), 1979.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> int(cvkern.threshold_otsu(np.array([[2, 3, 3], [80, 90, 80]], np.uint8)))
    3
    """
    image = check_image(image)
    nbins = check_integer(nbins, "nbins", 2, _WIDEST)
    rt = runtime(image)
    given = library(image).dtype(image)
    dtype = np.dtype(np.float64) if given.kind == "f" else given
    if dtype in (np.uint8, np.uint16):
        counts = count_levels(rt, image)
        low, high = np.nonzero(counts)[0][[0, -1]]
        if low == high:
            return dtype.type(low)
        counts, centers = counts[low : high + 1], np.arange(low, high + 1)
    else:
        values = np.ravel(rt.to_numpy(rt.adopt(image, dtype)))
        low, high = values.min(), values.max()
        if not np.isfinite([low, high]).all():
            raise ValueError("image must be finite")
        if low == high:
            return low
        if dtype.kind == "f":
            counts, edges = np.histogram(values, nbins)
            centers = (edges[:-1] + edges[1:]) / 2
        else:
            spread = int(high) - int(low)
            if spread >= _WIDEST:
                raise ValueError(f"image must hold integers at most 65535 apart, got {spread}")
            counts = np.bincount(values.astype(np.int64) - int(low))
            centers = int(low) + np.arange(spread + 1)
    below = np.cumsum(counts)[:-1]
    above = counts.sum() - below
    # Sums from the lowest value on, so that large values do not swamp their differences.
    places = centers - centers[0]
    sums = np.cumsum(counts * places)
    between = below * above * (sums[:-1] / below - (sums[-1] - sums[:-1]) / above) ** 2
    best = centers[int(np.argmax(between))]
    return dtype.type(best)


def count_levels(rt: Runtime, image: Any) -> np.ndarray:
    """Count how often each value of uint8 or uint16 occurs."""
    dtype = np.dtype(library(image).dtype(image))
    counts = rt.zeros((1 << 8 * dtype.itemsize,), np.int32)
    rt.color.contrast.count_levels(rt.adopt(image, dtype, (math.prod(image.shape),)), counts)
    return rt.to_numpy(counts).astype(np.int64)
