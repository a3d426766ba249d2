"""Arrays that are written part by part."""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cvkern.scale.engines import optional
from cvkern.scale.mapped import MappedRows, let_go

TIFF = ".tif", ".tiff"
SUFFIXES = ".npy", ".tif", ".zarr"


def target_of(file: Path, shape: Sequence[int], dtype: np.dtype, resumed: bool) -> Any:
    """Return an array on disk, new or as a run before left it."""
    if file.suffix == ".npy" or file.suffix.lower() in TIFF:
        try:
            return _mapped(file, shape, dtype, resumed)
        except OSError:
            if not resumed:
                file.unlink(missing_ok=True)
            raise
    if file.suffix == ".zarr":
        if resumed:
            return zarr_array(file, "target", mode="r+")
        return zarr_array(file, "target", mode="w", shape=tuple(shape), dtype=dtype)
    raise ValueError(f"target must end in .npy, .tif or .zarr, got {str(file)!r}")


def _mapped(file: Path, shape: Sequence[int], dtype: np.dtype, resumed: bool) -> Any:
    """Return an array of NumPy or a TIFF, as a memory map whose space on disk is taken."""
    if file.suffix == ".npy":
        mode = "r+" if resumed else "w+"
        array = np.lib.format.open_memmap(file, mode, None if resumed else dtype, tuple(shape))
        reserve(array)
        return array
    import tifffile

    kind = np.dtype(np.uint8) if dtype.kind == "b" else dtype
    given = {} if resumed else {"shape": tuple(shape), "dtype": kind}
    image: Any = tifffile.memmap(file, mode="r+", **given)
    reserve(image)
    return _Mask(image) if dtype.kind == "b" else image


def reserve(target: Any) -> None:
    """Take the space of a memory map on its disk.

    A disk that is full is an error then. Later it would be a signal that ends the process.
    """
    mapped = isinstance(target, np.memmap) and target.mode in ("r+", "w+")
    if not mapped or target.filename is None or not hasattr(os, "posix_fallocate"):
        return
    with open(target.filename, "r+b") as file:
        try:
            os.posix_fallocate(file.fileno(), 0, os.fstat(file.fileno()).st_size)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):  # not on this kind of disk
                raise OSError(error.errno, error.strerror, str(target.filename)) from None


def check_targets(
    target: Any, shapes: list[tuple[int, ...]], dtypes: list[np.dtype], sources: Sequence[Any]
) -> list[Any]:
    """Return the targets as a list, if they can hold the results and are not read meanwhile."""
    given = list(target) if isinstance(target, (tuple, list)) else [target]
    if [tuple(t.shape) for t in given] != shapes:
        got = ", ".join(str(tuple(t.shape)) for t in given)
        raise ValueError(f"target must have shape {', '.join(map(str, shapes))}, got {got}")
    for one, dtype in zip(given, dtypes, strict=True):
        if np.dtype(one.dtype) != dtype:
            raise ValueError(f"target must hold {dtype}, got {one.dtype}")
        if any(_shared(one, source) for source in sources):
            raise ValueError("target must not be source: tiles read what lies around them")
        reserve(one)
    return given


def _shared(one: Any, other: Any) -> bool:
    """Return whether two arrays have memory in common, or bytes of a file."""
    if one is other:
        return True
    if not (isinstance(one, np.ndarray) and isinstance(other, np.ndarray)):
        return False
    if np.may_share_memory(one, other, max_work=10**4):  # pyright: ignore[reportArgumentType]
        return True
    if not (isinstance(one, np.memmap) and isinstance(other, np.memmap)):
        return False
    if None in (one.filename, other.filename) or not os.path.samefile(one.filename, other.filename):  # pyright: ignore[reportArgumentType]
        return False
    return one.offset < other.offset + other.nbytes and other.offset < one.offset + one.nbytes


class _Mask:
    """A mask in an image of 0 and 255, as :func:`cvkern.images.write_image` writes it."""

    def __init__(self, image: np.ndarray) -> None:
        self.image, self.shape, self.dtype = image, image.shape, np.dtype(bool)

    def __getitem__(self, place: Any) -> np.ndarray:
        return self.image[place] > 0

    def __setitem__(self, place: Any, mask: np.ndarray) -> None:
        self.image[place] = _bytes_of(mask)


def _bytes_of(mask: np.ndarray) -> np.ndarray:
    return mask.view(np.uint8) * np.uint8(255)


def image_of(target: Any) -> Any:
    """Return the array that holds the pixels of a target."""
    return target.image if isinstance(target, _Mask) else target


class Writer:
    """Writes tiles into a target."""

    def __init__(self, target: Any) -> None:
        self.target, self.image = target, image_of(target)
        self.rows = MappedRows.of(self.image)

    def write(self, places: Sequence[Any], parts: Sequence[np.ndarray]) -> None:
        """Write parts of the result, as a rule those of a row of tiles."""
        if self.rows and places[0][0] is not ... and self._whole(places):
            stored = parts if self.image is self.target else [_bytes_of(part) for part in parts]
            self.rows.write(places[0][0].start, stored)
            return
        for place, part in zip(places, parts, strict=True):
            self.target[place] = part

    def _whole(self, places: Sequence[Any]) -> bool:
        return (places[0][1].start, places[-1][1].stop) == (0, self.image.shape[1])

    def let_go(self, rows: slice) -> None:
        """Let go of the memory of rows that are finished."""
        let_go(self.image, rows)

    def close(self) -> None:
        """Close the file of the target."""
        if self.rows:
            self.rows.close()


def zarr_array(file: Path, name: str, **options: Any) -> Any:
    """Open an array of Zarr."""
    library = optional("zarr", f"{name} {str(file)!r}")
    try:
        found = library.open_array(str(file), **options)
        if 0 in found.chunks:
            raise ValueError(f"its chunks are {found.chunks}")
        return found
    except OSError:
        raise
    except Exception as error:  # metadata may be damaged in any way
        raise ValueError(f"{name} must be an array of Zarr, got {str(file)!r}: {error}") from error
