"""Models as files: one ``.npz`` of plain arrays, with a line of JSON that says what they are."""

from __future__ import annotations

import json
import os
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from cvkern._files import check_target, replacing

FORMAT, VERSION = "cvkern radiance field", 3
HEADER = "header"

# What reading raises where bytes are missing, or are not what we write: a RuntimeError where they
# say that an array is encrypted, or packed in a way that zipfile does not know.
DAMAGED = (
    AttributeError, EOFError, KeyError, OSError, RuntimeError, TypeError, ValueError,
    zipfile.BadZipFile, zlib.error,
)  # fmt: skip


def write(path: str | os.PathLike[str], header: dict[str, Any], arrays: dict[str, Any]) -> None:
    """Write a model, whole or not at all."""
    header = {"format": FORMAT, "version": VERSION, **header}
    text = json.dumps(header, allow_nan=False, default=np.generic.item)  # settings may be NumPy's
    arrays = {HEADER: np.frombuffer(text.encode(), np.uint8), **arrays}
    with replacing(path) as beside, zipfile.ZipFile(beside, "w") as archive:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy")
            if not array.any():  # anything else hardly gets smaller
                entry.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(entry, "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)


def read(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return the header and the arrays of a model.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is no model, was cut short or damaged, or is of another version.
    """
    name = os.fspath(path)
    if not Path(path).is_file():
        raise FileNotFoundError(f"path must be a file that exists, got {name!r}")
    try:
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
        header = json.loads(arrays.pop(HEADER).tobytes())
        made, version = header["format"], header["version"]
    except DAMAGED as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"path must be a whole model, got {name!r}: {reason}") from error
    if made != FORMAT or version != VERSION:
        raise ValueError(
            f"path must hold a {FORMAT} of version {VERSION}, got {made!r} of version {version!r} "
            f"in {name!r}"
        )
    return header, arrays


def check_path(path: str | os.PathLike[str]) -> None:
    """Refuse a file that a model cannot be written to, before there is one that would be lost."""
    if Path(path).suffix.lower() != ".npz":
        raise ValueError(f"path must end in .npz, got {os.fspath(path)!r}")
    check_target(path)
