"""Read and write images."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import ArrayLike

from cvkern._checks import check_flag
from cvkern._files import as_path, replacing
from cvkern.images import _formats
from cvkern.images._overlay import check_numbers


def read_image(path: str | os.PathLike[str], *, orient: bool = True) -> np.ndarray:
    """Read an image file without rescaling its values.

    Parameters
    ----------
    path : path
        A file that Pillow or tifffile reads: PNG, TIFF, JPEG, WebP, BMP, GIF and others, of at most
        2^29 pixels, and no more than a file of that many bytes can hold with its compression. If
        it holds several images, the first is read.
    orient : bool
        Rotate and mirror the image as its EXIF orientation says.

    Returns
    -------
    array of shape (H, W) or (H, W, C) with C in 3, 4; uint8, uint16 or float32
        Palettes are expanded, 1-bit images become 0 and 255, CMYK becomes RGB, a transparent colour
        becomes an alpha channel, and grey with alpha becomes RGB with alpha (grey three times).

    Raises
    ------
    FileNotFoundError
        If there is no file `path`.
    ValueError
        If `path` is not an image, is damaged, or holds an unsupported kind of pixel.
    """
    orient = check_flag(orient, "orient")
    file = as_path(path)
    if not file.exists():
        raise FileNotFoundError(f"path must be a file that exists, got {str(file)!r}")
    if not file.is_file():
        raise ValueError(f"path must be a file, got {str(file)!r}")
    try:
        image, orientation = _formats.decode(file)
    except Exception as error:  # readers raise many types, even SyntaxError
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"path must be a readable image, got {str(file)!r}: {reason}") from error
    return np.ascontiguousarray(_formats.turn(image, orientation) if orient else image)


def write_image(path: str | os.PathLike[str], image: ArrayLike) -> None:
    """Write an image file, whole or not at all; every format but JPEG is lossless.

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
    suffix = as_path(path).suffix.lower()
    if suffix not in _formats.KEPT:
        raise ValueError(f"path must end in one of {tuple(_formats.KEPT)}, got {str(path)!r}")
    if array.dtype == bool:
        array = array * np.uint8(255)
    elif array.dtype.kind == "f":
        with np.errstate(over="ignore"):  # infinite then
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
