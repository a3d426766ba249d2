"""``cvkern develop``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import cvkern
from cvkern.app.commands import Backend, Device, Drawing, check_apart

SUFFIXES = (".dng", ".nef", ".cr2", ".cr3", ".arw", ".raf", ".orf", ".rw2", ".pef")


def develop(
    photo: Annotated[
        Path,
        typer.Argument(
            metavar="RAW", help="A camera's raw file, an image of samples, or a folder."
        ),
    ],
    output: Drawing,
    pattern: Annotated[
        str | None, typer.Option(help="Colours of a cell, row by row.", show_default="RGGB")
    ] = None,
    method: Annotated[
        str, typer.Option(help="Demosaicing: residual, menon, malvar or bilinear.")
    ] = "residual",
    black: Annotated[
        float | None, typer.Option(help="Value of no light.", show_default="the file's, or 0")
    ] = None,
    white: Annotated[
        float | None,
        typer.Option(help="Value that is clipped.", show_default="the file's, or the largest"),
    ] = None,
    tone: Annotated[
        str | None,
        typer.Option(help="Tone: reinhard, reinhard_local, bilateral or local_laplacian."),
    ] = None,
    highlights: Annotated[str, typer.Option(help="Clipped colours: rebuild or clip.")] = "rebuild",
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Develop a raw picture: light, colours, highlights, tone.

    Camera files are read by rawpy, where it is installed; other images hold the samples themselves.
    """
    from cvkern.images.files import read_image, write_image

    check_apart((photo,), output=output)
    if photo.suffix.lower() in SUFFIXES:
        raw, of_file, dark, full = _read(photo)
        pattern = pattern or of_file
        black, white = dark if black is None else black, full if white is None else white
    else:
        raw = read_image(photo)
        if raw.ndim != 2:
            raise ValueError(f"RAW must have one sample a pixel, got shape {raw.shape}")
    with cvkern.use(backend=backend, device=device):
        picture = cvkern.develop(
            raw, pattern or "RGGB", black=black or 0.0, white=white, method=method, tone=tone,
            highlights=highlights,
        )  # fmt: skip
    write_image(output, picture)
    typer.echo(f"{output}: {picture.shape[0]} x {picture.shape[1]}")


def _read(photo: Path) -> tuple[np.ndarray, str, float, float]:
    """Return the samples of a camera's file, their pattern, and the values of black and white."""
    try:
        import rawpy  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError:
        raise ImportError(
            f"{photo.suffix} files need rawpy, which is not installed: pip install rawpy"
        ) from None
    with rawpy.imread(str(photo)) as file:
        cell = "".join(chr(file.color_desc[i]) for i in np.asarray(file.raw_pattern).ravel())
        black = float(np.mean(file.black_level_per_channel))
        return file.raw_image_visible.copy(), cell, black, float(file.white_level)
