"""What a sensor behind a Bayer filter records."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_choice, check_rgb
from cvkern._runtime import runtime

PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG")


def red_place(pattern: str) -> tuple[int, int]:
    """Return row and column of the red sample in a cell of 2 x 2."""
    place = check_choice(pattern, PATTERNS, "pattern").index("R")
    return place // 2, place % 2


def mosaic(image: Any, pattern: str = "RGGB") -> Any:
    """Keep of each pixel the one colour that a Bayer filter lets through.

    Parameters
    ----------
    image : array of shape (H, W, 3)
        Red, green and blue, any real dtype.
    pattern : {'RGGB', 'BGGR', 'GRBG', 'GBRG'}, default 'RGGB'
        Colours of the cell of 2 x 2 pixels at the top left, row by row.

    Returns
    -------
    array of shape (H, W)
        Samples, of the dtype of the image.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If it is not of shape (H, W, 3), or the pattern is unknown.

    See Also
    --------
    demosaic : The way back.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> cvkern.mosaic(np.stack([np.full((2, 4), n) for n in (1, 2, 3)], axis=-1))
    array([[1, 2, 1, 2],
           [2, 3, 2, 3]])
    """
    image = check_rgb(image)
    row, column = red_place(pattern)
    y, x = np.indices((2, 2))
    channels = (y != row).astype(int) + (x != column)  # 0 red, 1 green, 2 blue
    if not library(image).writable:
        return runtime(image).give(_sampled(np.array(image), channels))
    return _sampled(image, channels)


def _sampled(image: Any, channels: np.ndarray) -> Any:
    """Take of each pixel the channel that its place in the cell has."""
    raw = image[..., 1] * 1  # a copy, in any library
    for y in (0, 1):
        for x in (0, 1):
            raw[y::2, x::2] = image[y::2, x::2, int(channels[y, x])]
    return raw
