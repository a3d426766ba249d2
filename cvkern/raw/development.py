"""From raw samples to a picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import as_numbers, check_choice, check_image, check_number
from cvkern._runtime import runtime
from cvkern.color import convert_color, estimate_illuminant
from cvkern.color.constancy import check_light
from cvkern.raw.demosaicing import demosaic
from cvkern.raw.mosaics import red_place
from cvkern.raw.tone import METHODS, tone_map

HIGHLIGHTS = ("clip", "rebuild")
CLIPPED = 0.99  # share of the white level


def develop(
    raw: Any,
    pattern: str = "RGGB",
    *,
    black: float = 0.0,
    white: float | None = None,
    illuminant: Any = None,
    highlights: str = "rebuild",
    method: str = "residual",
    matrix: Any = None,
    tone: str | None = None,
    dtype: Any = "uint8",
) -> Any:
    """Develop raw samples to a picture in sRGB.

    Parameters
    ----------
    raw : array of shape (H, W)
        Samples behind a Bayer filter, any real dtype.
    pattern : {'RGGB', 'BGGR', 'GRBG', 'GBRG'}, default 'RGGB'
        Colours of the cell of 2 x 2 pixels at the top left, row by row.
    black : float, default 0.0
        Value of no light.
    white : float, optional
        Value at which samples are clipped; the largest of them when omitted.
    illuminant : (red, green, blue), optional
        Colour of the light in the camera's values; `estimate_illuminant` when omitted.
    highlights : {'rebuild', 'clip'}, default 'rebuild'
        Where some colours are clipped: taken to be at least the mean of the others, or left white.
    method : {'residual', 'menon', 'malvar', 'bilinear'}, default 'residual'
        As for `demosaic`.
    matrix : array of shape (3, 3), optional
        From the camera's balanced colours to linear sRGB, as of `fit_color_matrix`.
    tone : {'reinhard', 'reinhard_local', 'bilateral', 'local_laplacian'}, optional
        As for `tone_map`; none when omitted.
    dtype : {'uint8', 'float32'}, default 'uint8'
        Of the result: 0 to 255, or 0 to 1.

    Returns
    -------
    array of shape (H, W, 3)
        The picture.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If shapes are not those above, an option is unknown, or `white` is not above `black`.

    Notes
    -----
    In this order: black level, white balance of the samples, demosaicing, highlights, matrix, tone,
    curve of sRGB. Balanced samples are interpolated more truly, as their colours are more alike;
    and clipped highlights are white, not magenta.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> raw = cvkern.mosaic(np.full((8, 8, 3), 100.0) * [0.5, 1, 0.7])
    >>> cvkern.develop(raw, white=200, illuminant=(0.5, 1, 0.7))[0, 0]
    array([188, 188, 188], dtype=uint8)
    """
    raw = check_image(raw, name="raw")
    row, column = red_place(pattern)
    check_choice(highlights, HIGHLIGHTS, "highlights")
    if tone is not None:
        check_choice(tone, METHODS, "tone")
    black = check_number(black, "black")
    rt = runtime(raw)
    values = np.array(rt.to_numpy(rt.adopt(raw)), np.float32) - np.float32(black)
    most = float(values.max()) if white is None else check_number(white, "white") - black
    if white is not None and most <= 0:
        raise ValueError(f"white must be above black, {black:g}, got {white:g}")
    # NaN where the brightest value is infinite; with a white too small for float32, light is white.
    smallest = float(np.finfo(np.float32).tiny)
    with np.errstate(invalid="ignore", over="ignore"):
        values = (values / np.float32(max(most, smallest) if most > 0 else 1)).clip(0, 1)
    if illuminant is None:
        illuminant = estimate_illuminant(demosaic(values, pattern, "bilinear"), white=1.0)
    light = check_light(illuminant)
    gains = (light.max() / light).astype(np.float32)  # at least 1: no clipped value becomes dark
    cell = np.array([[gains[(y != row) + (x != column)] for x in (0, 1)] for y in (0, 1)])
    height, width = values.shape
    balanced = values * np.tile(cell, (-(-height // 2), -(-width // 2)))[:height, :width]
    colours = np.asarray(demosaic(balanced, pattern, method))
    if highlights == "rebuild":
        over = np.asarray(demosaic(values, pattern, "bilinear")) >= CLIPPED
        others = (colours.sum(axis=2, keepdims=True) - colours) / 2
        colours = np.where(over, np.maximum(colours, others), colours)
    else:
        colours = colours.clip(0, 1)
    if matrix is not None:
        numbers = as_numbers(matrix, "matrix")
        if numbers.shape != (3, 3):
            raise ValueError(f"matrix must have shape (3, 3), got {numbers.shape}")
        colours = colours @ numbers.T.astype(np.float32)
    if tone is not None:
        # Taichi takes denormal numbers for 0, and the roots of some are large.
        colours = np.where(np.abs(colours) < smallest, np.float32(0), colours)
        colours = np.asarray(tone_map(colours, tone))
    found = convert_color(colours.clip(0, 1), "rgb", "srgb", dtype=dtype)
    return found if library(raw) is library(found) else rt.give(np.asarray(found))


def fit_color_matrix(measured: Any, wanted: Any) -> np.ndarray:
    """Fit the matrix from a camera's colours to others, from a chart.

    Parameters
    ----------
    measured : array of shape (N, 3)
        The camera's linear colours of at least 3 patches, balanced so that white is (1, 1, 1).
    wanted : array of shape (N, 3)
        What they should be, as linear sRGB.

    Returns
    -------
    (3, 3) float64
        Acts on (red, green, blue). Its rows add up to 1, so that what is grey stays grey.

    Raises
    ------
    TypeError
        If an array is not of numbers.
    ValueError
        If shapes are not those above.

    Notes
    -----
    Least squares under the constraint on the rows.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> true = np.array([[1.5, -0.3, -0.2], [-0.2, 1.4, -0.2], [0.1, -0.6, 1.5]])
    >>> measured = np.eye(3)
    >>> bool(np.allclose(cvkern.fit_color_matrix(measured, measured @ true.T), true))
    True
    """
    measured, wanted = as_numbers(measured, "measured"), as_numbers(wanted, "wanted")
    if measured.ndim != 2 or measured.shape[1] != 3 or len(measured) < 3:
        raise ValueError(f"measured must have shape (N >= 3, 3), got {measured.shape}")
    if wanted.shape != measured.shape:
        raise ValueError(f"wanted must have shape {measured.shape}, got {wanted.shape}")
    # The last column is 1 less the others, so each row has two unknowns.
    last = measured[:, 2:]
    two = np.linalg.lstsq(measured[:, :2] - last, wanted - last, rcond=None)[0]
    return np.vstack([two, 1 - two.sum(axis=0)]).T
