"""Arrays in files that are read and written part by part."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cvkern.images.files import read_image
from cvkern.scale.engines import optional

TIFF = ".tif", ".tiff"
SUFFIXES = ".npy", ".tif", ".zarr"


def opened(file: Path) -> Any:
    """Return the image of a file, as far as possible without reading it."""
    if not file.exists():
        raise FileNotFoundError(f"source must be a file that exists, got {str(file)!r}")
    if file.suffix == ".npy":
        try:
            return np.load(file, mmap_mode="r", allow_pickle=False)
        except ValueError as error:
            raise ValueError(f"source must be an array of NumPy, got {str(file)!r}") from error
    if file.suffix == ".zarr":
        return _zarr(file, "source", mode="r")
    if file.suffix.lower() in TIFF:
        import tifffile

        try:
            return tifffile.memmap(file, mode="r")
        except (ValueError, tifffile.TiffFileError):  # compressed, or in pieces
            pass
    return read_image(file)


def target_of(file: Path, shape: Sequence[int], dtype: np.dtype, resumed: bool) -> Any:
    """Return an array on disk, new or as a run before left it."""
    if file.suffix == ".npy":
        mode = "r+" if resumed else "w+"
        return np.lib.format.open_memmap(file, mode, None if resumed else dtype, tuple(shape))
    if file.suffix.lower() in TIFF:
        import tifffile

        kind = np.dtype(np.uint8) if dtype.kind == "b" else dtype
        given = {} if resumed else {"shape": tuple(shape), "dtype": kind}
        array: Any = tifffile.memmap(file, mode="r+", **given)
        return _Mask(array) if dtype.kind == "b" else array
    if file.suffix == ".zarr":
        if resumed:
            return _zarr(file, "target", mode="r+")
        return _zarr(file, "target", mode="w", shape=tuple(shape), dtype=dtype)
    raise ValueError(f"target must end in .npy, .tif or .zarr, got {str(file)!r}")


class _Mask:
    """A mask in an image of 0 and 255, as :func:`cvkern.images.write_image` writes it."""

    def __init__(self, image: np.ndarray) -> None:
        self.image, self.shape, self.dtype = image, image.shape, np.dtype(bool)

    def __getitem__(self, place: Any) -> np.ndarray:
        return self.image[place] > 0

    def __setitem__(self, place: Any, mask: np.ndarray) -> None:
        self.image[place] = np.where(mask, 255, 0)


def _zarr(file: Path, name: str, **options: Any) -> Any:
    return optional("zarr", f"{name} {str(file)!r}").open_array(str(file), **options)
