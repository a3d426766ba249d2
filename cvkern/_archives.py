"""Archives: one ``.npz`` of plain arrays, with a JSON header that describes them."""

from __future__ import annotations

import json
import math
import os
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cvkern._files import as_path, check_target, replacing

HEADER = "header"
ARCHIVE = b"PK\x03\x04"  # first bytes of every archive
MOST_HEADER, MOST_BYTES = 2**20, 2**36

# Exceptions of reading if bytes are missing or wrong. It is a RuntimeError if the bytes say that an
# array is encrypted, or packed by a method that zipfile does not know; NumPy's headers are Python,
# of which a string may not end.
DAMAGED = (
    AttributeError, EOFError, IndexError, KeyError, OSError, OverflowError, RuntimeError,
    TypeError, ValueError,
    tokenize.TokenError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


def map_array(file: Path, name: str) -> np.ndarray:
    """Map the array of a ``.npy`` file, which takes no memory for what a damaged header claims.

    Raises
    ------
    ValueError
        If it is another file, or is damaged; `name` is the argument that led to it.
    """
    try:
        with np.errstate(over="ignore"):  # a header may claim more bytes than 64 bits count
            found = np.load(file, mmap_mode="r", allow_pickle=False)
        if not isinstance(found, np.ndarray):
            raise ValueError("it is an archive")
        return found
    except FileNotFoundError:
        raise
    except DAMAGED as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(
            f"{name} must be an array of NumPy, got {str(file)!r}: {reason}"
        ) from error


class Kind(NamedTuple):
    """What an archive holds."""

    format: str
    version: int
    names: tuple[str, ...]
    """Entries besides the header."""
    groups: tuple[str, ...] = ()
    """Parts of names before a dot; the entries of a group are not listed."""


def write(
    path: str | os.PathLike[str],
    kind: Kind,
    header: dict[str, Any],
    arrays: dict[str, Any],
    *,
    packed: bool = False,
) -> None:
    """Write an archive, whole or not at all; `packed` takes longer, and is a little smaller."""
    header = {"format": kind.format, "version": kind.version, **header}
    text = json.dumps(header, allow_nan=False, default=np.generic.item)  # NumPy scalars in settings
    arrays = {HEADER: np.frombuffer(text.encode(), np.uint8), **arrays}
    with replacing(path) as beside, zipfile.ZipFile(beside, "w") as archive:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy")
            if packed or not array.any():  # floats of full precision hardly get smaller
                entry.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(entry, "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)


class Stored(Mapping[str, np.ndarray]):
    """The arrays of a model that is open: each is read when it is asked for, and not kept."""

    def __init__(self, file: Any, headers: dict[str, tuple[tuple[int, ...], np.dtype]], group=""):
        self._file, self._headers, self._group = file, headers, group

    def __getitem__(self, name: str) -> np.ndarray:
        return self._file[self._group + name]

    def __contains__(self, name: object) -> bool:
        return f"{self._group}{name}" in self._headers  # Mapping's own would read the array

    def __iter__(self) -> Iterator[str]:
        return (n.removeprefix(self._group) for n in self._headers if n.startswith(self._group))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an array that is not read yet."""
        return self._headers[self._group + name][0]

    def part(self, group: str) -> Stored:
        """Return the arrays of one group, without its name."""
        return Stored(self._file, self._headers, f"{self._group}{group}.")


def shape_of(arrays: Mapping[str, np.ndarray], name: str) -> tuple[int, ...]:
    """Return the shape of an array, without reading it where it is still in its file."""
    return arrays.shape(name) if isinstance(arrays, Stored) else arrays[name].shape


@contextmanager
def opened(path: str | os.PathLike[str], kind: Kind) -> Iterator[tuple[dict[str, Any], Stored]]:
    """Yield the header and the arrays of a model.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is not a model, is incomplete or damaged, or has another version.
    """
    file = as_path(path)
    name = os.fspath(file)
    if not file.is_file():
        raise FileNotFoundError(f"path must be a file that exists, got {name!r}")
    try:
        with open(path, "rb") as stream:
            begin = stream.read(len(ARCHIVE))
        if begin and begin != ARCHIVE:
            raise ValueError(f"path must be a model of cvkern, got {name!r}, which is another file")
    except OSError as error:
        raise ValueError(f"path must be a whole model, got {name!r}: {error}") from error
    try:
        with open(path, "rb") as stream:
            headers = _survey(stream, kind)
            with np.load(stream, allow_pickle=False) as file:
                header = json.loads(file[HEADER].tobytes())
                _check_version(kind, header["format"], header["version"])
                yield header, Stored(file, headers)
    except DAMAGED as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        reason = f"no {reason}" if isinstance(error, KeyError) else reason
        raise ValueError(f"path must be a whole model, got {name!r}: {reason}") from error


def _check_version(kind: Kind, made: Any, version: Any) -> None:
    if made != kind.format or version != kind.version:
        raise ValueError(
            f"it must be a {kind.format} of version {kind.version}, "
            f"got {made!r} of version {version!r}"
        )


def _survey(stream: Any, kind: Kind) -> dict[str, tuple[tuple[int, ...], np.dtype]]:
    """Return shape and dtype of each entry, before any is read.

    Refuse unknown entries, and entries of a wrong size. A packed entry may claim far more bytes
    than the file holds.
    """
    total, found = 0, {}
    with zipfile.ZipFile(stream) as archive:
        for entry in archive.infolist():
            key = entry.filename.removesuffix(".npy")
            if key not in (HEADER, *kind.names) and key.partition(".")[0] not in kind.groups:
                raise ValueError(f"it must not have an entry {key!r}")
            with archive.open(entry) as file:
                version = np.lib.format.read_magic(file)
                if version == (1, 0):
                    shape, _, dtype = np.lib.format.read_array_header_1_0(file)
                else:
                    shape, _, dtype = np.lib.format.read_array_header_2_0(file)
                size = math.prod(shape) * dtype.itemsize
                if size != entry.file_size - file.tell():
                    raise ValueError(
                        f"{key} must have the {size} bytes of its shape {shape}, got "
                        f"{entry.file_size - file.tell()}"
                    )
            total += size
            found[key] = shape, dtype
            if key == HEADER and size > MOST_HEADER:
                raise ValueError(f"its header must have at most {MOST_HEADER} bytes, got {size}")
    if total > MOST_BYTES:
        raise ValueError(f"its arrays must have at most {MOST_BYTES} bytes in all, got {total}")
    stream.seek(0)
    return found


def check_path(path: str | os.PathLike[str]) -> None:
    """Refuse a path that a model cannot be written to, before there is a model to lose."""
    if as_path(path).suffix.lower() != ".npz":
        raise ValueError(f"path must end in .npz, got {os.fspath(path)!r}")
    check_target(path)
