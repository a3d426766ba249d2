"""Illusions of brightness, and what a model of lateral inhibition says about them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_choice, check_image, check_integer, check_number, check_positive
from cvkern.filters import gaussian

MOST_SIGMA = 2**18 - 1  # pixels: a Gaussian reaches four times as far, 2^20 at most
LEAST = 64  # pixels of a side, below which the details of the figures are lost


class Illusion(NamedTuple):
    """A figure, and two places of the same light that do not look the same."""

    image: np.ndarray
    """(H, W) float32: light, 0 to 1."""
    lighter: np.ndarray
    """(H, W) bool: the place that people see lighter."""
    darker: np.ndarray
    """(H, W) bool: the place that they see darker."""


def illusion(kind: str, side: int = 256) -> Illusion:
    """Draw a figure in which equal light does not look equal.

    Parameters
    ----------
    kind : str
        'simultaneous_contrast': a grey square on black and on white. 'checker_shadow': a white
        field of a board in shadow, and a black one in light. 'cornsweet': two equal fields that
        meet in an edge which fades away on both sides. 'mach_bands': a ramp between two levels, at
        whose ends a bright and a dark band are seen; the places are the bands. 'white': grey bars
        in the black and in the white stripes of a grating.
    side : int, default 256
        Height and width in pixels, 64 to 4096.

    Returns
    -------
    Illusion
        The image and two masks. Light is equal in both masks, but in Mach bands: there each lies
        in the even field just beside the ramp, and looks unlike the rest of that field.

    Raises
    ------
    ValueError
        If the kind is unknown or the side is out of range.

    See Also
    --------
    lateral_inhibition : What neurons that inhibit their neighbours make of it.

    Notes
    -----
    Drawn on the host, equal on all devices.

    References
    ----------
    .. [1] E. H. Adelson, "Lightness perception and lightness illusions", The New Cognitive
       Neurosciences, 2000: the board in shadow.
    .. [2] T. N. Cornsweet, "Visual Perception", 1970.
    .. [3] M. White, "A new effect of pattern on perceived lightness", Perception 8, 1979.

    Examples
    --------
    >>> import cvkern
    >>> figure = cvkern.illusion("simultaneous_contrast")
    >>> [float(figure.image[mask].mean()) for mask in (figure.lighter, figure.darker)]
    [0.5, 0.5]
    """
    check_choice(kind, tuple(DRAWN), "kind")
    side = check_integer(side, "side", LEAST, 4096)
    rows, columns = (np.indices((side, side)) + 0.5) / side
    image, lighter, darker = DRAWN[kind](rows, columns)
    return Illusion(np.asarray(image, np.float32), lighter, darker)


def lateral_inhibition(
    image: Any, center: float = 1.0, surround: float = 8.0, weight: float = 0.9
) -> Any:
    """Take the light around each place off the light in it: a difference of Gaussians.

    Parameters
    ----------
    image : array of shape (H, W)
        Light, any real dtype.
    center, surround : float, default 1.0 and 8.0
        Standard deviations in pixels of what excites a cell, and of what inhibits it: above
        0, below 2^18.
    weight : float, default 0.9
        Of the surround, 0 or more: with 1, even light gives no answer at all.

    Returns
    -------
    array of shape (H, W), float32
        Answer of a cell at each pixel: the prediction of how light it looks.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If it is of another shape, a deviation is not in its range, or the weight is negative.

    Notes
    -----
    Sums are those of `gaussian`, with the image reflected outside. The model tells simultaneous
    contrast, the board in shadow and Mach bands, where the surround reaches beyond the figure. Of
    Cornsweet's fields it tells the edge alone, not that its sign spreads over them. White's bars
    have more of the other stripes around them, so it says the opposite of what people see: there is
    more behind lightness than inhibition.

    References
    ----------
    .. [1] R. W. Rodieck, "Quantitative analysis of cat retinal ganglion cell response to visual
       stimuli", Vision Research 5, 1965.
    .. [2] F. Ratliff, "Mach Bands: Quantitative Studies on Neural Networks in the Retina", 1965.

    Examples
    --------
    >>> import cvkern
    >>> figure = cvkern.illusion("simultaneous_contrast")
    >>> seen = cvkern.lateral_inhibition(figure.image, surround=40.0)
    >>> bool(seen[figure.lighter].mean() > seen[figure.darker].mean())
    True
    """
    image = check_image(image, ndim=(2,))
    center, surround = check_positive(center, "center"), check_positive(surround, "surround")
    for sigma, name in ((center, "center"), (surround, "surround")):
        if sigma > MOST_SIGMA:
            raise ValueError(f"{name} must be at most {MOST_SIGMA}, got {sigma:g}")
    weight = check_number(weight, "weight", low=0)
    # The light may be infinite around a place and in it, or become so.
    with np.errstate(invalid="ignore", over="ignore"):
        return gaussian(image, center) - weight * gaussian(image, surround)


def _box(rows: np.ndarray, columns: np.ndarray, middle: float) -> np.ndarray:
    return (np.abs(rows - 0.5) < 0.1) & (np.abs(columns - middle) < 0.1)


def _contrast(rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, ...]:
    on_black, on_white = _box(rows, columns, 0.25), _box(rows, columns, 0.75)
    image = np.where(on_black | on_white, 0.5, np.where(columns < 0.5, 0.1, 0.9))
    return image, on_black, on_white


def _checker(rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, ...]:
    row, column = (6 * rows).astype(int), (6 * columns).astype(int)
    paint = np.where((row + column) % 2 == 0, 0.8, 0.4)
    way = ((columns - 0.4) / 0.2).clip(0, 1)
    image = paint * (1 - 0.5 * way * way * (3 - 2 * way))
    return image, (row == 2) & (column == 4), (row == 2) & (column == 1)


def _cornsweet(rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, ...]:
    away = columns - 0.5
    image = 0.5 - 0.25 * np.sign(away) * (1 - np.abs(away) / 0.15).clip(0) ** 2
    inside = (np.abs(away) > 0.2) & (np.abs(rows - 0.5) < 0.3)
    return image, inside & (away < 0), inside & (away > 0)


def _mach(rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, ...]:
    image = 0.3 + 0.4 * ((columns - 0.35) / 0.3).clip(0, 1)
    return image, (columns > 0.65) & (columns < 0.67), (columns < 0.35) & (columns > 0.33)


def _white(rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, ...]:
    stripe = (16 * columns).astype(int)
    tall = np.abs(rows - 0.5) < 0.15
    in_black = tall & np.isin(stripe, (2, 4, 6))
    in_white = tall & np.isin(stripe, (9, 11, 13))
    image = np.where(in_black | in_white, 0.5, np.where(stripe % 2 == 0, 0.05, 0.95))
    return image, in_black, in_white


DRAWN = {
    "simultaneous_contrast": _contrast,
    "checker_shadow": _checker,
    "cornsweet": _cornsweet,
    "mach_bands": _mach,
    "white": _white,
}
