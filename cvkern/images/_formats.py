"""Conversion of image files to arrays and back, with the reader that suits each file."""

from __future__ import annotations

import contextlib
import logging
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cvkern._checks import MAX_ELEMENTS
from cvkern.images import _png

# Dtypes and channel counts (0 for 2-D) that each format keeps exactly (JPEG nearly).
KEPT: dict[str, tuple[tuple[str, ...], tuple[int, ...]]] = {
    ".png": (("uint8", "uint16"), (0, 3, 4)),
    ".tif": (("uint8", "uint16", "float32"), (0, 3, 4)),
    ".tiff": (("uint8", "uint16", "float32"), (0, 3, 4)),
    ".jpg": (("uint8",), (0, 3)),
    ".jpeg": (("uint8",), (0, 3)),
    ".webp": (("uint8",), (3, 4)),
    ".bmp": (("uint8",), (0, 3)),
}
PHOTOGRAPHS = frozenset(KEPT)  # endings of files
OPTIONS: dict[str, dict[str, Any]] = {
    ".jpg": {"quality": 95},
    ".jpeg": {"quality": 95},
    ".webp": {"lossless": True, "exact": True},
}
TIFF_SIGNATURES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
# The most bytes of pixels that a byte of a TIFF file can hold, by its compression. The last number
# is for those that code equal pixels without a bound that matters.
TIFF_RATIOS = {1: 1, 5: 4096, 8: 1032, 32773: 64, 32946: 1032}
TIFF_RATIO = 2**17
# The most pixels that a byte of a file can hold, by its format or by the decoder of its pixels.
PIXELS_A_BYTE = {"PNG": 8 * 1032, "PPM": 8, "raw": 8}
SKIPPED = 64  # rows that a byte of a run-length coded bitmap can skip, nearly: 255 by 4 bytes
ORIENTATION = 274  # the TIFF and EXIF tag
# Pillow's modes, and the modes to read them as. Other modes (LAB, HSV, ...) are not RGB.
MODES = {
    **dict.fromkeys(("L", "RGB", "RGBA", "I", "I;16", "I;16L", "I;16B", "I;16N", "F")),
    **dict.fromkeys(("CMYK", "YCbCr", "RGBX"), "RGB"),
    **dict.fromkeys(("LA", "PA", "RGBa"), "RGBA"),
    "1": "L",
    "P": "RGB",
}
KEYED = ("1", "L", "P", "RGB")  # modes in which one colour may mean "transparent"


def decode(file: Path) -> tuple[np.ndarray, int]:
    """Return the pixels as stored in the file, (H, W) or (H, W, C), and its orientation tag."""
    for name in ("PIL", "tifffile"):  # keep their messages off stderr by default
        logger = logging.getLogger(name)
        if not logger.handlers:
            logger.addHandler(logging.NullHandler())
    with file.open("rb") as stream:
        tiff = stream.read(4) in TIFF_SIGNATURES
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # readers warn of odd metadata, which is not used here
        if tiff:
            return _decode_tiff(file)
        deep = _png.is_deep_colour(file)
        image, orientation = _png.read(file) if deep else _decode_pillow(file)
    return _plain(image), orientation


def turn(image: np.ndarray, orientation: int) -> np.ndarray:
    """Return an upright view of `image`, by the eight values of the EXIF orientation tag."""
    if orientation in (5, 6, 7, 8):
        image = image.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    return image


def encode(file: Path, image: np.ndarray) -> None:
    """Write `image`, whose dtype and channels `KEPT` lists for the suffix of `file`."""
    suffix = file.suffix.lower()
    if suffix in (".tif", ".tiff"):
        import tifffile

        tifffile.imwrite(
            file,
            image,
            photometric="minisblack" if image.ndim == 2 else "rgb",
            extrasamples=["unassalpha"] if image.shape[2:] == (4,) else None,
            metadata=None,
        )
    elif suffix == ".png" and image.dtype == np.uint16 and image.ndim == 3:
        _png.write(file, image)
    else:
        import imageio.v3 as iio

        iio.imwrite(file, image, plugin="pillow", extension=suffix, **OPTIONS.get(suffix, {}))


class _Limit:
    """Pillow's global limit, as it was before the first thread began to read."""

    lock = threading.Lock()
    readers = 0
    before: int | None = None


@contextlib.contextmanager
def _large() -> Iterator[None]:
    """Let Pillow read as many pixels as the library allows, and refuse more with a message."""
    from PIL import Image

    with _Limit.lock:
        if not _Limit.readers:
            _Limit.before = Image.MAX_IMAGE_PIXELS
            Image.MAX_IMAGE_PIXELS = MAX_ELEMENTS // 2
        _Limit.readers += 1
    try:
        yield
    except Image.DecompressionBombError:  # Pillow raises it above twice the limit
        raise ValueError(f"it has more than {MAX_ELEMENTS} pixels") from None
    finally:
        with _Limit.lock:
            _Limit.readers -= 1
            if not _Limit.readers:
                Image.MAX_IMAGE_PIXELS = _Limit.before


def _decode_pillow(file: Path, sides: list[int] | None = None) -> tuple[np.ndarray, int]:
    """Read with Pillow; `sides` are what another reader found, the shorter one first."""
    with _large():
        return _decode_by_pillow(file, sides)


def _decode_by_pillow(file: Path, sides: list[int] | None) -> tuple[np.ndarray, int]:
    import imageio.v3 as iio
    from PIL import Image

    try:
        with Image.open(file) as opened:  # reports a file that is too large; the reader does not
            (width, height), kind = opened.size, opened.format or ""
            decoders = {part[0] for part in opened.tile}
        reader: Any = iio.imopen(file, "r", plugin="pillow")
    except OSError:
        with file.open("rb") as given:
            heic = given.read(12)[4:] in (b"ftypheic", b"ftypheix", b"ftypmif1", b"ftypmsf1")
        what = "it is HEIC: save it as JPEG" if heic else "it has no format that Pillow knows"
        raise ValueError(what) from None
    if sides is not None and sorted((width, height)) != sides:
        raise ValueError(f"its sides are {sides} or {sorted((width, height))}, and not both")
    ratios = {**PIXELS_A_BYTE, "bmp_rle": SKIPPED * (width + 1)}
    ratio = min(ratios.get(key, MAX_ELEMENTS) for key in (kind, *decoders))
    most = ratio * file.stat().st_size
    if width * height > most:
        raise ValueError(f"it has {height} x {width} pixels, and its bytes hold at most {most}")
    with reader:
        header: dict[str, Any] = reader.metadata(index=0, exclude_applied=False)
        orientation = header.get("Orientation", 1)
        mode = header["mode"]
        if mode not in MODES:
            raise ValueError(f"pixels of kind {mode} are not supported")
        keyed = mode in KEYED and "transparency" in header
        return reader.read(index=0, mode="RGBA" if keyed else MODES[mode]), orientation


def _check_tiff(page: Any, size: int) -> None:
    """Refuse a page of more pixels than a file of `size` bytes can hold, before they are held."""
    pixels = page.imagewidth * page.imagelength * page.imagedepth
    samples = 1 if page.photometric == 6 else page.samplesperpixel  # YCbCr may share samples
    needed = -(-pixels * samples * page.bitspersample // 8)
    ratio = TIFF_RATIOS.get(int(page.compression), TIFF_RATIO)
    if needed > ratio * size:
        raise ValueError(
            f"{page.imagelength} x {page.imagewidth} pixels are {needed} bytes, and its {size} "
            f"bytes hold at most {ratio * size}"
        )


def _decode_tiff(file: Path) -> tuple[np.ndarray, int]:
    import tifffile

    with tifffile.TiffFile(file) as tiff:
        page: Any = tiff.pages[0]
        _check_tiff(page, file.stat().st_size)
        tag = page.tags.get(ORIENTATION)
        orientation = int(tag.value) if tag else 1
        if page.samplesperpixel > 1 and page.bitspersample > 8:  # Pillow would cut to 8 bits
            image = page.asarray()
            planar = page.planarconfig == tifffile.PLANARCONFIG.SEPARATE
            return _plain(np.moveaxis(image, 0, -1) if planar else image), orientation
    image, _ = _decode_pillow(file, sorted((page.imagewidth, page.imagelength)))
    # Pillow itself rotates TIFF, and only TIFF, so undo this. Codes 6 and 8 undo each other.
    return turn(_plain(image), {6: 8, 8: 6}.get(orientation, orientation)), orientation


def _plain(image: np.ndarray) -> np.ndarray:
    """Return uint8, uint16 or float32, (H, W) or with 3 or 4 channels; grey + alpha is expanded."""
    if image.ndim == 3 and image.shape[2] in (1, 2):
        image = image[..., 0] if image.shape[2] == 1 else image[..., [0, 0, 0, 1]]
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (3, 4)):
        raise ValueError(f"pixels of shape {image.shape} are not supported")
    if image.dtype.kind == "f":
        return image.astype(np.float32, copy=False)
    if image.dtype.itemsize <= 2 and image.dtype.kind == "u":
        return image.astype(image.dtype.newbyteorder("="), copy=False)
    low, high = int(image.min()), int(image.max())  # PGM and TIFF may hold 16 bits in wide integers
    if low < 0 or high > 65535:
        raise ValueError(f"integers of more than 16 bits are not supported, got {low} to {high}")
    return image.astype(np.uint16)
