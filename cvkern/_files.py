"""Files written whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def check_target(path: str | os.PathLike[str]) -> Path:
    """Return the file that `path` leads to if it can be written; call this before long work.

    Raises
    ------
    FileNotFoundError
        If the folder of `path` does not exist.
    PermissionError
        If nothing can be written in that folder.
    ValueError
        If `path` exists and is not a regular file.
    """
    target = Path(os.path.realpath(as_path(path)))
    if not target.parent.is_dir():
        raise FileNotFoundError(f"path must lie in a folder that exists, got {os.fspath(path)!r}")
    if target.exists() and not target.is_file():
        raise ValueError(f"path must name a regular file, got {os.fspath(path)!r}")
    if not os.access(target.parent, os.W_OK):
        raise PermissionError(f"path must lie in a folder to write to, got {os.fspath(path)!r}")
    return target


def as_path(path: Any, name: str = "path") -> Path:
    """Return `path` as one."""
    try:
        return Path(path)
    except TypeError:
        got = type(path).__name__
        raise TypeError(f"{name} must be a string or a path, got {got}") from None


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`, and move what was written there over `path`.

    The temporary name keeps the suffix of `path`, because writers read the format from it. When
    the block raises, the temporary file is deleted and `path` keeps its contents.

    Parameters
    ----------
    path : path
        The file to write; a symbolic link is followed. Its folder must exist.

    Raises
    ------
    FileNotFoundError, PermissionError, ValueError
        As :func:`check_target`.
    """
    target = check_target(path)
    # A fixed-length name: one made from a long file name could exceed the limit of 255 bytes.
    beside = target.with_name(f".{secrets.token_hex(8)}.part{target.suffix}")
    try:
        yield beside
        os.replace(beside, target)
    except BaseException:  # an interrupt must not leave the temporary file either
        beside.unlink(missing_ok=True)
        raise


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write `text` to `path` as UTF-8 with Unix line ends, whole or not at all."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", newline="\n")
