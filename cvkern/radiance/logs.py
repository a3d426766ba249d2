"""What a training tells while it runs: to a function of the user, and to a log."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from cvkern._files import as_path


class Look(NamedTuple):
    """What the host sees of a training every few steps; the names are the columns of a log."""

    step: int
    seconds: float
    """Time spent in these steps."""
    loss: float
    """Mean squared error of the colours of the last batch."""
    psnr: float
    """The same in decibels."""
    rays_per_second: float
    test_psnr: float
    """Mean over held-out views if they were looked at after this step, else NaN."""
    test_ssim: float


Write = Callable[[Look], None]
Watch = Callable[[Look], bool]


def check_log(path: str | os.PathLike[str]) -> Path:
    """Return the path of a log, which can be written: a CSV file, or a folder for TensorBoard.

    Raises
    ------
    FileNotFoundError
        If the folder of the path does not exist.
    ModuleNotFoundError
        If the path has no ending, and TensorBoard is not installed.
    ValueError
        If the path ends otherwise than in ``.csv``, or is of another kind.
    """
    at = as_path(path, "log")
    if at.suffix.lower() not in ("", ".csv"):
        raise ValueError(f"log must end in .csv, or be a folder, got {os.fspath(path)!r}")
    table = bool(at.suffix)
    if at.exists() and at.is_dir() == table:
        wanted = "a file" if table else "a folder"
        raise ValueError(f"log must be {wanted}, got {os.fspath(path)!r}")
    if not at.parent.is_dir():
        raise FileNotFoundError(f"log must lie in a folder that exists, got {os.fspath(path)!r}")
    if not table:
        _board()
    return at


@contextmanager
def opened(path: Path, resume: bool) -> Iterator[Write]:
    """Yield a function that adds a line to a log; a later line of the same step replaces it."""
    if not path.suffix:
        with _board()(os.fspath(path)) as board:
            yield lambda look: _tell(board, look)
        return
    goes_on = resume and path.exists() and path.stat().st_size > 0
    with path.open("a" if goes_on else "w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        if not goes_on:
            table.writerow(Look._fields)
        last: list[Look] = []

        def put() -> None:
            for look in last:
                table.writerow("" if v != v else v if type(v) is int else f"{v:.6g}" for v in look)
            file.flush()
            last.clear()

        def write(look: Look) -> None:
            if last and last[0].step != look.step:
                put()
            last[:] = [look]

        try:
            yield write
        finally:
            put()


def _tell(board: Any, look: Look) -> None:
    """Add the numbers of a look to TensorBoard's log."""
    for name, value in zip(Look._fields[1:], look[1:], strict=True):
        if not math.isnan(value):
            board.add_scalar(name, value, look.step)


def _board() -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter  # pyright: ignore
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            "a log for TensorBoard needs PyTorch: pip install torch tensorboard; "
            "a log that ends in .csv needs neither"
        ) from None
    return SummaryWriter
