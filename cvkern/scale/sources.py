"""Images that are read window by window: arrays, and files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from cvkern._archives import map_array
from cvkern.images.files import read_image
from cvkern.scale.mapped import touch
from cvkern.scale.targets import TIFF, zarr_array

Place = tuple[slice, slice]
UPRIGHT, GRAY, RGB, CONTIGUOUS = 1, 1, 2, 1  # values of tags of TIFF
FORMATS = {
    "uchar": np.uint8, "char": np.int8, "ushort": np.uint16, "short": np.int16,
    "uint": np.uint32, "int": np.int32, "float": np.float32, "double": np.float64,
}  # fmt: skip


def opened(file: Path) -> Any:
    """Return the image of a file, as far as possible without reading it."""
    if not file.exists():
        raise FileNotFoundError(f"source must be a file that exists, got {str(file)!r}")
    if file.suffix == ".npy":
        return map_array(file, "source")
    if file.suffix == ".zarr":
        return zarr_array(file, "source", mode="r")
    if file.suffix.lower() in TIFF:
        import tifffile

        try:
            return _tiff(file)
        # Other kinds of pixels, or a compression that tifffile alone does not read.
        except (ValueError, tifffile.TiffFileError):
            pass
    return read_image(file)


def _tiff(file: Path) -> Any:
    """Return the first image of a TIFF, mapped into memory or in pieces."""
    import tifffile

    with tifffile.TiffFile(file) as tiff:
        page: Any = tiff.pages[0]
        tag = page.tags.get("Orientation")
        plain = page.photometric in (GRAY, RGB) and page.planarconfig == CONTIGUOUS
        if not plain or page.imagedepth != 1 or (tag is not None and tag.value != UPRIGHT):
            raise ValueError("read_image has to arrange its pixels")
        if page.is_memmappable:
            return tifffile.memmap(file, page=0, mode="r")
        pieces = _Pieces(file, page)
    pieces[:1, :1]  # raises what all of them would
    return pieces


class _Pieces:
    """An image in tiles or strips, of which a window decodes those that it touches."""

    def __init__(self, file: Path, page: Any) -> None:
        self.file, self.decode, self.tables = file, page.decode, page.jpegtables
        self.shape, self.dtype = tuple(page.shape), np.dtype(page.dtype)
        self.chunks = tuple(page.chunks[:2])
        self.places = page.dataoffsets, page.databytecounts

    def __getitem__(self, place: Place) -> np.ndarray:
        (top, bottom, _), (left, right, _) = (
            part.indices(size) for part, size in zip(place, self.shape, strict=False)
        )
        high, wide = self.chunks
        across = -(-self.shape[1] // wide)
        window = np.zeros((bottom - top, right - left, *self.shape[2:]), self.dtype)
        with open(self.file, "rb") as stream:
            for row in range(top // high, -(-bottom // high)):
                for column in range(left // wide, -(-right // wide)):
                    piece = self._piece(stream, row * across + column)
                    if piece is None:  # nothing was stored of it
                        continue
                    y, x = row * high, column * wide
                    piece = piece[max(top - y, 0) : bottom - y, max(left - x, 0) : right - x]
                    y, x = max(y - top, 0), max(x - left, 0)
                    window[y : y + piece.shape[0], x : x + piece.shape[1]] = piece
        return window

    def _piece(self, stream: BinaryIO, number: int) -> np.ndarray | None:
        """Return the pixels of a piece, or None."""
        offset, count = (places[number] for places in self.places)
        if not count:
            return None
        stream.seek(offset)
        try:
            found, _, shape = self.decode(stream.read(count), number, jpegtables=self.tables)
        except Exception as error:  # decoders raise many types
            raise ValueError(
                f"source must be a readable image, got {str(self.file)!r}: {error}"
            ) from error
        found = found[0, : shape[1], : shape[2]]
        return found if len(self.shape) == 3 else found[..., 0]


class _Vips:
    """An image of pyvips."""

    def __init__(self, image: Any) -> None:
        bands = (image.bands,) if image.bands > 1 else ()
        self.image, self.shape = image, (image.height, image.width, *bands)
        if image.format not in FORMATS:
            raise TypeError(f"source must hold real numbers, got {image.format}")
        self.dtype = np.dtype(FORMATS[image.format])

    def __getitem__(self, place: Place) -> np.ndarray:
        rows, columns = place
        height, width = rows.stop - rows.start, columns.stop - columns.start
        part = self.image.crop(columns.start, rows.start, width, height)
        return np.asarray(part).reshape(height, width, *self.shape[2:])


def images_of(source: Any, number: int) -> tuple[tuple[Any, ...], tuple[int, ...]]:
    """Return the sources, which are so many images of one shape, and this shape."""
    sources = source if number > 1 and isinstance(source, tuple) else (source,)
    if len(sources) != number:
        raise ValueError(f"source must be a tuple of {number} images, got {len(sources)}")
    sources = tuple(_Vips(s) if hasattr(s, "bands") and hasattr(s, "crop") else s for s in sources)
    shapes = []
    for one in sources:
        shape = getattr(one, "shape", None)
        if shape is None or len(shape) not in (2, 3) or 0 in shape:
            got = type(one).__name__ if shape is None else tuple(shape)
            raise ValueError(f"source must be an array of shape (H, W) or (H, W, C), got {got}")
        shapes.append(tuple(int(n) for n in shape))
    if len(set(shapes)) > 1:
        raise ValueError(f"source must be images of one shape, got {shapes}")
    return sources, shapes[0]


def cut(source: Any, window: Place, name: str) -> np.ndarray:
    """Return a window of a source; that of an array of NumPy is no copy."""
    _check_file(source, name)
    try:
        part = source[window]
    except (TypeError, IndexError, NotImplementedError) as error:  # a memoryview has the last one
        got = type(source).__name__
        raise TypeError(
            f"{name} must give arrays for slices of rows and columns, got {got}"
        ) from error
    except (OSError, MemoryError):
        raise
    except Exception as error:  # readers raise many types
        if str(error).startswith(f"{name} must"):
            raise
        got = type(source).__name__
        raise ValueError(f"{name} must be readable, got {got}: {error}") from error
    if isinstance(part, np.ma.MaskedArray):
        raise TypeError(f"{name} must not be masked, got {type(source).__name__}")
    part = np.asarray(part)
    want = tuple(side.stop - side.start for side in window)
    if part.shape[:2] != want:
        raise ValueError(f"{name} must keep its shape, got {part.shape} in place of {want}")
    touch(part)
    return part


def _check_file(source: Any, name: str) -> None:
    """Refuse a memory map of a file that has become shorter: to read it would end the process."""
    if isinstance(source, np.memmap) and source.filename is not None:
        size = os.stat(source.filename).st_size
        if size < source.offset + source.nbytes:
            raise ValueError(f"{name} must keep its size, got a file of {size} bytes")
