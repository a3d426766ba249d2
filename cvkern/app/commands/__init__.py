"""The subcommands of ``cvkern`` that work on photographs, one module each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from cvkern.images._formats import PHOTOGRAPHS as PHOTOGRAPHS

Backend = Annotated[
    str | None, typer.Option(help="Kernel set: warp or taichi.", show_default="warp")
]
Device = Annotated[
    str | None, typer.Option(help="Device: cpu, cuda or cuda:N.", show_default="cpu")
]

Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace results that are there: tables, models, films.")
]

Photo = Annotated[Path, typer.Argument(metavar="PHOTO", help="Image to read, or a folder of them.")]
Drawing = Annotated[
    Path, typer.Option("--output", "-o", help="Image to write; a folder, if one is read.")
]
Picture = Annotated[Path, typer.Option("--output", "-o", help="Image to write.")]
Csv = Annotated[Path | None, typer.Option("--csv", help="CSV to write them to.")]
Json = Annotated[Path | None, typer.Option("--json", help="JSON to write them to.")]
Low = Annotated[
    float | None,
    typer.Option(help="Gradient above which an edge continues.", show_default="from the image"),
]
High = Annotated[
    float | None,
    typer.Option(help="Gradient above which an edge starts.", show_default="from the image"),
]
Seed = Annotated[int, typer.Option(help="Seed of all random numbers.")]

Folder = Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder to write.")]
OverwriteFolder = Annotated[
    bool, typer.Option("--overwrite", help="Replace the results that DIR has.")
]


def check_folder(output: Path, results: Sequence[str], overwrite: bool) -> None:
    """Refuse a folder that has one of these results already, unless it may be replaced."""
    if output.exists() and not output.is_dir():
        raise ValueError(f"output must be a folder, got the file {str(output)!r}")
    kept = [] if overwrite else [name for name in results if (output / name).exists()]
    if kept:
        raise ValueError(
            f"output must have no results yet, got {str(output / kept[0])!r}: "
            "--overwrite replaces them"
        )


def check_apart(read: Iterable[Path], **written: Path | None) -> None:
    """Refuse a result in a file that is read, and two results in one file."""
    taken = {path.resolve() for path in read}
    for name, path in written.items():
        if path is None:
            continue
        if path.resolve() in taken:
            raise ValueError(
                f"{name} must not be a file that is read, nor that of another result, "
                f"got {str(path)!r}"
            )
        taken.add(path.resolve())


def check_new(path: Path | None, name: str, overwrite: bool, or_else: str = "") -> None:
    """Refuse a file of results that is there already, unless it may be replaced."""
    if path is not None and path.exists() and not overwrite:
        raise ValueError(
            f"{name} must be a new file, got {str(path)!r}: {or_else}--overwrite replaces it"
        )


def rows_and_columns(text: str, name: str, such: str, least: int) -> tuple[int, int]:
    """Return rows and columns of COLUMNSxROWS, each at least `least`."""
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdecimal() and int(part) >= least for part in parts):
        raise ValueError(f"{name} must be COLUMNSxROWS, {such}, got {text!r}")
    return int(parts[1]), int(parts[0])


def as_gray(image: np.ndarray) -> np.ndarray:
    """Return the grey values of an image from a file, rounded to the dtype of the file."""
    from cvkern.images.colors import luma

    if image.ndim == 2:
        return image
    gray = luma(image)
    return gray.round().astype(image.dtype) if image.dtype.kind == "u" else gray


def write_csv(file: Path, names: str, *columns: np.ndarray) -> None:
    """Write columns, (N,) or (N, K), below a line with their names."""
    table = np.column_stack(columns)
    # Nine digits hold a float32.
    np.savetxt(file, table, fmt="%.9g", delimiter=",", header=names, comments="")


def progress_bar() -> Any:
    """Return a progress bar on the standard error; it is shown only on a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (BarColumn(32), MofNCompleteColumn(), TextColumn("{task.description}"))
    console = Console(stderr=True)
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
