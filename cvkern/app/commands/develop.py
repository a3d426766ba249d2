"""``cvkern develop``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer

import cvkern
from cvkern.app.commands import Backend, Device, Drawing, check_apart

TURNS = {3: 2, 5: 1, 6: 3}  # quarters of a turn for the codes of LibRaw
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
    light: Annotated[
        str | None,
        typer.Option(
            help="White balance: camera or estimate.",
            show_default="that of the camera, if the file has it",
        ),
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

    Camera files are read by rawpy, where it is installed, with their pattern, levels, white
    balance, colours and orientation. Other images hold the samples themselves.
    """
    from cvkern.images.files import read_image, write_image

    check_apart((photo,), output=output)
    if light not in (None, "camera", "estimate"):
        raise ValueError(f"light must be 'camera' or 'estimate', got {light!r}")
    matrix, illuminant, turns = None, None, 0
    if photo.suffix.lower() in SUFFIXES:
        shot = _read(photo)
        raw, matrix, turns = shot.samples, shot.matrix, shot.turns
        illuminant = None if light == "estimate" else shot.light
        pattern = pattern or shot.pattern
        black = shot.black if black is None else black
        white = shot.white if white is None else white
    else:
        raw = read_image(photo)
        if raw.ndim != 2:
            raise ValueError(f"RAW must have one sample a pixel, got shape {raw.shape}")
    if light == "camera" and illuminant is None:
        raise ValueError(f"light must be 'estimate' for {str(photo)!r}, which has none")
    with cvkern.use(backend=backend, device=device):
        picture = cvkern.develop(
            raw, pattern or "RGGB", black=black or 0.0, white=white, method=method, tone=tone,
            highlights=highlights, matrix=matrix, illuminant=illuminant,
        )  # fmt: skip
    picture = np.rot90(picture, turns)
    write_image(output, picture)
    typer.echo(f"{output}: {picture.shape[0]} x {picture.shape[1]}")


class Shot(NamedTuple):
    """What a camera wrote into its file."""

    samples: np.ndarray
    pattern: str
    black: float
    white: float
    light: np.ndarray | None
    """White in the camera's colours, if it is known."""
    matrix: np.ndarray | None
    """From the camera's balanced colours to linear sRGB, if it is known."""
    turns: int
    """Quarters of a turn to the left after which the picture is upright."""


def _read(photo: Path) -> Shot:
    """Read a camera's file."""
    try:
        import rawpy  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError:
        raise ImportError(
            f"{photo.suffix} files need rawpy, which is not installed: pip install rawpy"
        ) from None
    if not photo.is_file():
        raise FileNotFoundError(f"RAW must be a file that exists, got {str(photo)!r}")
    try:
        with rawpy.imread(str(photo)) as file:
            samples = file.raw_image_visible.copy()
            if file.raw_pattern is None or samples.ndim != 2:
                raise ValueError(f"RAW must come from behind a Bayer filter, got {str(photo)!r}")
            cell = "".join(chr(file.color_desc[i]) for i in np.asarray(file.raw_pattern).ravel())
            matrix = np.asarray(file.color_matrix, np.float64)[:, :3]
            gains = np.array(file.camera_whitebalance[:3], np.float64)
            return Shot(
                samples, cell, float(np.mean(file.black_level_per_channel)),
                float(file.white_level), 1 / gains if (gains > 0).all() else None,
                matrix if matrix.any() else None, TURNS.get(file.sizes.flip, 0),
            )  # fmt: skip
    except rawpy.LibRawError as error:
        raise ValueError(f"RAW must be a camera's raw file, got {str(photo)!r}") from error
