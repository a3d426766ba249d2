"""Conversion of colours to grey values, and of values to colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cvkern._checks import check_choice, check_number, refuse_masks
from cvkern.images._colormaps import COLORMAPS, STEPS, table
from cvkern.images._overlay import check_color, check_numbers

LUMA = (0.2125, 0.7154, 0.0721)  # weights of Rec. 709 and skimage.color.rgb2gray


def luma(image: ArrayLike, *, channel_axis: int = -1) -> np.ndarray:
    """Return the grey of a colour image: ``0.2125 R + 0.7154 G + 0.0721 B``.

    Parameters
    ----------
    image : array of shape (H, W), or with 3 or 4 channels along `channel_axis`
        A fourth channel, alpha, is ignored. A grey image is returned as float32.
    channel_axis : int
        Axis of the channels.

    Returns
    -------
    array of shape (H, W), float32
        In the units of `image`: values are not rescaled.

    Raises
    ------
    ValueError
        If the shape is wrong, or `image` is empty or does not hold real numbers.
    """
    array = check_numbers(image, "image")
    refuse_masks(channel_axis=channel_axis)
    if array.ndim == 2:
        return _narrow(array)
    if not isinstance(channel_axis, (int, np.integer)):
        raise TypeError(f"channel_axis must be an integer, got {channel_axis!r}")
    if array.ndim != 3 or not -3 <= channel_axis < 3:
        raise ValueError(
            f"image must be 2-D, or 3-D with a channel axis, got shape {array.shape} "
            f"and channel_axis {channel_axis}"
        )
    channels = np.moveaxis(array, channel_axis, 0)
    if len(channels) not in (3, 4):
        raise ValueError(f"image must have 3 or 4 channels, got shape {array.shape}")
    red, green, blue = (np.float32(w) * c for w, c in zip(LUMA, _narrow(channels[:3]), strict=True))
    with np.errstate(all="ignore"):  # infinite values may cancel
        return red + green + blue


def _narrow(values: np.ndarray) -> np.ndarray:
    """Return values as float32; those beyond its range are infinite."""
    with np.errstate(over="ignore"):
        return values.astype(np.float32)


def apply_colormap(
    values: ArrayLike,
    name: str = "sequential",
    *,
    vmin: float | None = None,
    vmax: float | None = None,
    nan: tuple[int, int, int] = (255, 0, 255),
) -> np.ndarray:
    """Show values as colours.

    Parameters
    ----------
    values : array of shape (H, W)
        Real numbers.
    name : {"sequential", "gray", "diverging", "cyclic"}
        "sequential" runs from dark to light in even steps of lightness; "gray" runs from black to
        white; "diverging" runs from blue through near white to red; "cyclic", for angles, runs once
        around the hues at constant lightness.
    vmin, vmax : float, optional
        Values of the first and last colour. Values outside get the end colours; in "cyclic" they
        wrap around. By default the smallest and largest finite value, and for "cyclic" -pi and pi.
    nan : (red, green, blue)
        Colour of NaN: magenta.

    Returns
    -------
    array of shape (H, W, 3), uint8

    Raises
    ------
    ValueError
        If `values` is not 2-D or is empty, `name` is unknown, or `vmin` exceeds `vmax`.
    """
    array = check_numbers(values, "values")
    if array.ndim != 2:
        raise ValueError(f"values must be 2-D, got shape {array.shape}")
    check_choice(name, COLORMAPS, "name")
    array = array.astype(np.float64)
    finite = array[np.isfinite(array)]
    cyclic = name == "cyclic"
    ends = (-np.pi, np.pi) if cyclic else (0.0, 1.0)
    if finite.size and not cyclic:
        ends = (float(finite.min()), float(finite.max()))
    low = ends[0] if vmin is None else check_number(vmin, "vmin")
    high = ends[1] if vmax is None else check_number(vmax, "vmax")
    if not (np.isfinite(low) and np.isfinite(high) and low <= high):
        raise ValueError(f"vmin must be finite and <= vmax, got {low} and {high}")
    missing = np.isnan(array) | (np.isinf(array) if cyclic else False)
    # A range of width 0 has only the first colour.
    with np.errstate(over="ignore"):
        t = (np.where(missing, low, array) - low) / ((high - low) or 1.0)
    index = np.floor(t * STEPS) % STEPS if cyclic else np.round(t.clip(0.0, 1.0) * (STEPS - 1))
    colours = table(name)[index.astype(np.intp)]
    colours[missing] = check_color(nan, "nan")
    return colours
