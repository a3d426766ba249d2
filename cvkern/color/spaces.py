"""From one colour space to another, in one pass."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_choice, check_depth, check_image
from cvkern._runtime import runtime
from cvkern.color.spectra import white_point
from cvkern.kernels.codes import color as codes
from cvkern.kernels.codes.color import FIRST, STEPS, Form

SPACES = ("srgb", "rgb", "xyz", "lms", "lab", "lch")
FORMS = {"srgb": Form.SRGB, "lab": Form.LAB, "lch": Form.LCH}
# IEC 61966-2-1: the primaries of sRGB, and white at (0.3127, 0.3290).
PRIMARIES = np.array([[0.64, 0.33, 0.03], [0.3, 0.6, 0.1], [0.15, 0.06, 0.79]]).T
WHITE = np.array([0.3127 / 0.329, 1.0, (1 - 0.3127 - 0.329) / 0.329])
TO_XYZ = PRIMARIES * np.linalg.solve(PRIMARIES, WHITE)


def convert_color(
    image: Any,
    source: str,
    target: str,
    *,
    adapt: Any = None,
    white: Any = None,
    dtype: Any = "float32",
) -> Any:
    """Convert colours from one space to another.

    Parameters
    ----------
    image : array of shape (..., 3)
        Colours: a point, a list or an image. sRGB in 0 to 1, uint8 in 0 to 255, or uint16 in 0 to
        65535.
    source, target : {'srgb', 'rgb', 'xyz', 'lms', 'lab', 'lch'}
        The spaces: sRGB, its linear values, CIE XYZ with Y = 1 for white, responses of cones (Hunt,
        Pointer and Estevez, for equal energy), CIE L*a*b*, and L*, chroma and hue in degrees.
    adapt : pair of str or (X, Y, Z), optional
        Two lights or white points: colours under the first become those that look the same under
        the second, as of `adapt_colors`.
    white : str or (X, Y, Z), optional
        White of L*a*b*: a light of `standard_light`, or a white point; that of sRGB when omitted.
    dtype : {'float32', 'uint8'}, default 'float32'
        Of the result: with uint8, sRGB in 0 to 255, rounded to the nearest and limited.

    Returns
    -------
    array of shape (..., 3)
        Colours. With uint8 they are limited, and NaN is 0; else nothing is, and NaN stays.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If the last axis is not 3 long, a space is unknown, `adapt` is not a pair, a white is not
        three positive numbers, or uint8 is asked for another space than sRGB.

    Notes
    -----
    One kernel undoes the curve of the source, multiplies by one matrix, made in float64 of all that
    lie between, and applies the curve of the target. With uint8 the result is equal in every bit on
    all devices: exact thresholds stand for the curve.

    References
    ----------
    .. [1] IEC 61966-2-1:1999, sRGB.
    .. [2] CIE 15:2018, "Colorimetry", section 8.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.convert_color([[1, 0.5, 0]], "srgb", "lab").round(1)
    array([[67. , 43.1, 74. ]], dtype=float32)
    """
    check_choice(source, SPACES, "source")
    check_choice(target, SPACES, "target")
    reference = WHITE if white is None else white_point(white, "white")
    middle = _to_xyz(source, reference)
    if adapt is not None:
        from cvkern.color.adaptation import adaptation_matrix

        if not isinstance(adapt, (tuple, list)) or len(adapt) != 2:
            raise ValueError(f"adapt must be a pair of lights, got {adapt!r}")
        before, after = (white_point(light, "adapt") for light in adapt)
        middle = adaptation_matrix(before, after) @ middle
    matrix = np.linalg.solve(_to_xyz(target, reference), middle)
    return apply_matrix(image, matrix, source, target, dtype)


def apply_matrix(
    image: Any,
    matrix: np.ndarray,
    source: str,
    target: str = "xyz",
    dtype: Any = np.float32,
    name: str = "image",
) -> Any:
    """Undo a curve, multiply by a matrix, and apply a curve."""
    image = check_image(image, ndim=(1, 2, 3), name=name)
    if image.shape[-1] != 3:
        raise ValueError(f"{name} must have shape (..., 3), got {tuple(image.shape)}")
    dtype = check_depth(dtype)
    if dtype == np.uint8 and target != "srgb":
        raise ValueError(f"dtype must be float32 for {target!r}, got uint8")
    rt = runtime(image)
    given = library(image).dtype(image)
    most = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}.get(given, 1)
    shape = tuple(image.shape)
    flat = (int(np.prod(shape[:-1])), 3)
    # On identity curves the scale could join the matrix; sRGB's curve needs it before.
    scale = np.float32(1 / most if source == "srgb" else 1)
    numbers = np.append(matrix.astype(np.float32).ravel(), scale)
    result = rt.empty(shape, dtype)
    source_form = int(FORMS.get(source, Form.LINEAR))
    colours = rt.adopt(image, np.float32, flat)
    if dtype == np.uint8:
        rt.color.spaces.encode(
            colours, source_form, rt.constant(numbers), rt.constant(_steps()),
            rt.adopt(result, dtype, flat),
        )  # fmt: skip
    else:
        rt.color.spaces.convert(
            colours, source_form, int(FORMS.get(target, Form.LINEAR)), rt.constant(numbers),
            rt.adopt(result, dtype, flat),
        )  # fmt: skip
    return rt.release(result)


def _to_xyz(space: str, white: np.ndarray) -> np.ndarray:
    """Return the matrix from the linear colours of a space to XYZ."""
    if space in ("srgb", "rgb"):
        return TO_XYZ
    if space in ("lab", "lch"):
        return np.diag(white)
    if space == "lms":
        # Hunt, Pointer and Estevez, as in CIECAM02: equal energy gives (1, 1, 1).
        cones = np.array(
            [[0.38971, 0.68898, -0.07868], [-0.22981, 1.1834, 0.04641], [0.0, 0.0, 1.0]]
        )
        return np.linalg.inv(cones)
    return np.eye(3)


def thresholds() -> np.ndarray:
    """Return the linear values, float32, from which on the nearest code is 1, 2, ..., 255."""
    middle = (np.arange(255) + 0.5) / 255
    curved = ((middle + codes.SRGB_SHIFT) / codes.SRGB_SCALE) ** codes.SRGB_POWER
    straight = middle / codes.SRGB_SLOPE
    return np.where(straight <= codes.SRGB_LOW, straight, curved).astype(np.float32)


@lru_cache
def _steps() -> np.ndarray:
    """Return a number for each upper half of a value's bits: its code is that of their sum.

    The upper half of the number is the code of the least such value. The lower half is what the
    threshold within, if there is one, lacks to the next.
    """
    ups = thresholds()
    first = ((FIRST + np.arange(STEPS)) << 16).astype(np.int32)
    steps = np.searchsorted(ups, first.view(np.float32), side="right") << 16
    bits = ups.view(np.int32)
    inside = bits[(bits & 0xFFFF) > 0]
    steps[(inside >> 16) - FIRST] += 0x10000 - (inside & 0xFFFF)
    return steps.astype(np.int32)
