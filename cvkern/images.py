"""Read and write images, show values as colours, and draw over photographs.

Images are NumPy arrays of shape (H, W) or (H, W, C). Positions are (row, column) in pixels, and
pixel centres are integers.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cvkern import _formats, _overlay
from cvkern._colormaps import COLORMAPS, STEPS, table
from cvkern._files import replacing
from cvkern._overlay import check_color, check_numbers

__all__ = [
    "COLORMAPS",
    "apply_colormap",
    "draw_circles",
    "draw_lines",
    "draw_points",
    "luma",
    "overlay_mask",
    "read_image",
    "write_image",
]

LUMA = (0.2125, 0.7154, 0.0721)  # Rec. 709, as skimage.color.rgb2gray


def read_image(path: str | os.PathLike[str], *, orient: bool = True) -> np.ndarray:
    """Read an image file, with the values that it holds.

    Parameters
    ----------
    path : path
        Of a file that Pillow or tifffile reads: PNG, TIFF, JPEG, WebP, BMP, GIF and others. Of a
        file with several images the first is read.
    orient : bool
        Turn and mirror the image as its EXIF orientation asks for.

    Returns
    -------
    array of shape (H, W) or (H, W, C) with C in 3, 4; uint8, uint16 or float32
        Palettes are expanded, bits become 0 and 255, CMYK becomes RGB, a transparent colour
        becomes an alpha channel, and grey with alpha becomes RGB with alpha (grey three times).

    Raises
    ------
    FileNotFoundError
        If there is no file `path`.
    ValueError
        If `path` is no image, is damaged, or holds a kind of pixel that is not supported.
    """
    file = Path(path)
    if not file.exists():
        raise FileNotFoundError(f"path must be a file that exists, got {str(file)!r}")
    if not file.is_file():
        raise ValueError(f"path must be a file, got {str(file)!r}")
    try:
        image, orientation = _formats.decode(file)
    except Exception as error:  # readers raise dozens of types, SyntaxError among them
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"path must be a readable image, got {str(file)!r}: {reason}") from error
    return np.ascontiguousarray(_formats.turn(image, orientation) if orient else image)


def write_image(path: str | os.PathLike[str], image: ArrayLike) -> None:
    """Write an image file, whole or not at all, and without loss but for JPEG.

    Parameters
    ----------
    path : path
        Its suffix names the format: ``.png``, ``.tif``, ``.tiff``, ``.jpg``, ``.jpeg``,
        ``.webp`` or ``.bmp``. An existing file is replaced once the new one is complete.
    image : array of shape (H, W) or (H, W, C) with C in 3, 4
        uint8 (every format), uint16 (PNG, TIFF), floats (TIFF, as float32), or bool (as 0 and
        255).

    Raises
    ------
    FileNotFoundError
        If the folder of `path` does not exist.
    ValueError
        If the format is unknown or cannot hold such an image without loss.
    """
    array = check_numbers(image, "image")
    suffix = Path(path).suffix.lower()
    if suffix not in _formats.KEPT:
        raise ValueError(f"path must end in one of {tuple(_formats.KEPT)}, got {str(path)!r}")
    if array.dtype == bool:
        array = array * np.uint8(255)
    elif array.dtype.kind == "f":
        array = array.astype(np.float32)
    dtypes, channels = _formats.KEPT[suffix]
    if array.dtype.name not in dtypes:
        raise ValueError(f"image must be {' or '.join(dtypes)} for {suffix}, got {array.dtype}")
    if array.ndim not in (2, 3) or (array.shape[2] if array.ndim == 3 else 0) not in channels:
        shapes = " or ".join(f"(H, W, {c})" if c else "(H, W)" for c in channels)
        raise ValueError(f"image must have shape {shapes} for {suffix}, got {array.shape}")
    array = np.ascontiguousarray(array.astype(array.dtype.newbyteorder("="), copy=False))
    with replacing(path) as beside:
        _formats.encode(beside, array)


def luma(image: ArrayLike, *, channel_axis: int = -1) -> np.ndarray:
    """Return the grey of a colour image: ``0.2125 R + 0.7154 G + 0.0721 B``.

    Parameters
    ----------
    image : array of shape (H, W), or with 3 or 4 channels along `channel_axis`
        A fourth channel, alpha, is ignored. Grey passes through.
    channel_axis : int
        Axis of the channels.

    Returns
    -------
    array of shape (H, W), float32
        In the units of `image`: values are not rescaled.

    Raises
    ------
    ValueError
        If the shape is another, or `image` is empty or holds no real numbers.
    """
    array = check_numbers(image, "image")
    if array.ndim == 2:
        return array.astype(np.float32)
    if array.ndim != 3 or not -3 <= channel_axis < 3:
        raise ValueError(
            f"image must be 2-D, or 3-D with a channel axis, got shape {array.shape} "
            f"and channel_axis {channel_axis}"
        )
    channels = np.moveaxis(array, channel_axis, 0)
    if len(channels) not in (3, 4):
        raise ValueError(f"image must have 3 or 4 channels, got shape {array.shape}")
    red, green, blue = (
        np.float32(w) * c for w, c in zip(LUMA, channels[:3].astype(np.float32), strict=True)
    )
    return red + green + blue


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
        "sequential" runs dark to light in even steps of tone; "diverging" runs from blue over
        near white to red; "cyclic" goes once round the hues at one lightness, for angles.
    vmin, vmax : float, optional
        Values of the first and last colour. Values beyond get the end colours; in "cyclic" they
        wrap round. By default the least and greatest finite value, and for "cyclic" -pi and pi.
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
    if name not in COLORMAPS:
        raise ValueError(f"name must be one of {COLORMAPS}, got {name!r}")
    array = array.astype(np.float64)
    finite = array[np.isfinite(array)]
    cyclic = name == "cyclic"
    ends = (-np.pi, np.pi) if cyclic else (0.0, 1.0)
    if finite.size and not cyclic:
        ends = (float(finite.min()), float(finite.max()))
    low, high = ends[0] if vmin is None else vmin, ends[1] if vmax is None else vmax
    if not (np.isfinite(low) and np.isfinite(high) and low <= high):
        raise ValueError(f"vmin must be finite and <= vmax, got {low} and {high}")
    missing = np.isnan(array) | (np.isinf(array) if cyclic else False)
    # A range of no width has one colour: the first.
    t = (np.where(missing, low, array) - low) / ((high - low) or 1.0)
    index = np.floor(t * STEPS) % STEPS if cyclic else np.round(t.clip(0.0, 1.0) * (STEPS - 1))
    colours = table(name)[index.astype(np.intp)]
    colours[missing] = check_color(nan, "nan")
    return colours


def draw_points(
    image: ArrayLike,
    points: ArrayLike,
    *,
    color: ArrayLike = (255, 64, 64),
    radius: float = 2.0,
) -> np.ndarray:
    """Draw filled discs over an image, anti-aliased and placed to a fraction of a pixel.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4
        uint8, uint16, bool, or floats in [0, 1]. Alpha is ignored.
    points : array of shape (N, 2)
        Centres, (row, column), pixels. What lies outside the image is cut off.
    color : array of shape (3,) or (N, 3)
        Red, green, blue in [0, 255], for all or for each.
    radius : float
        Pixels, > 0.

    Returns
    -------
    array of shape (H, W, 3), uint8
        A new array.

    Raises
    ------
    ValueError
        If an argument is out of the ranges above or is not finite.
    """
    canvas, centres = _overlay.canvas(image), _overlay.check_rows(points, 2, "points")
    half = _overlay.check_positive(radius, "radius")
    return _overlay.blend(
        canvas, *_overlay.discs(centres), half, _overlay.check_colors(color, len(centres))
    )


def draw_lines(
    image: ArrayLike,
    segments: ArrayLike,
    *,
    color: ArrayLike = (255, 64, 64),
    width: float = 1.5,
) -> np.ndarray:
    """Draw line segments with round ends over an image, anti-aliased.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4
        As in `draw_points`.
    segments : array of shape (N, 4)
        End points: row, column, row, column, pixels. What lies outside the image is cut off.
    color : array of shape (3,) or (N, 3)
        Red, green, blue in [0, 255], for all or for each.
    width : float
        Pixels, > 0.

    Returns
    -------
    array of shape (H, W, 3), uint8
        A new array.

    Raises
    ------
    ValueError
        If an argument is out of the ranges above or is not finite.
    """
    canvas, ends = _overlay.canvas(image), _overlay.check_rows(segments, 4, "segments")
    half = 0.5 * _overlay.check_positive(width, "width")
    places, distance = _overlay.segments(ends, half, canvas.shape[:2])
    return _overlay.blend(canvas, places, distance, half, _overlay.check_colors(color, len(ends)))


def draw_circles(
    image: ArrayLike,
    circles: ArrayLike,
    *,
    color: ArrayLike = (255, 64, 64),
    width: float = 1.5,
) -> np.ndarray:
    """Draw the outlines of circles over an image, anti-aliased.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4
        As in `draw_points`.
    circles : array of shape (N, 3)
        Row and column of the centre, and radius >= 0, pixels. What lies outside is cut off.
    color : array of shape (3,) or (N, 3)
        Red, green, blue in [0, 255], for all or for each.
    width : float
        Of the outline, pixels, > 0; half of it lies inside the circle.

    Returns
    -------
    array of shape (H, W, 3), uint8
        A new array.

    Raises
    ------
    ValueError
        If an argument is out of the ranges above or is not finite.
    """
    canvas, rings = _overlay.canvas(image), _overlay.check_rows(circles, 3, "circles")
    if (rings[:, 2] < 0).any():
        raise ValueError(f"circles must have radii >= 0, got {rings[:, 2].min()}")
    half = 0.5 * _overlay.check_positive(width, "width")
    places, distance = _overlay.circles(rings, half, canvas.shape[:2])
    return _overlay.blend(canvas, places, distance, half, _overlay.check_colors(color, len(rings)))


def overlay_mask(
    image: ArrayLike,
    mask: ArrayLike,
    *,
    color: tuple[int, int, int] = (255, 64, 64),
    opacity: float = 1.0,
) -> np.ndarray:
    """Colour the pixels of an image where a mask is not zero.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4
        As in `draw_points`.
    mask : array of shape (H, W)
        Bool, or numbers: not zero is on.
    color : (red, green, blue)
        In [0, 255].
    opacity : float
        In [0, 1].

    Returns
    -------
    array of shape (H, W, 3), uint8
        A new array.

    Raises
    ------
    ValueError
        If an argument is out of the ranges above, or the shapes differ.
    """
    canvas, on = _overlay.canvas(image), np.asarray(mask)
    if on.shape != canvas.shape[:2]:
        raise ValueError(f"mask must have shape {canvas.shape[:2]}, got {on.shape}")
    if not 0.0 <= opacity <= 1.0:
        raise ValueError(f"opacity must lie in [0, 1], got {opacity}")
    on = on != 0
    mixed = (1.0 - opacity) * canvas[on] + opacity * check_color(color, "color")
    canvas[on] = np.round(mixed).astype(np.uint8)
    return canvas
