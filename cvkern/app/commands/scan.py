"""``cvkern scan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import cvkern
from cvkern.app.commands import (
    PHOTOGRAPHS,
    Backend,
    Device,
    Folder,
    OverwriteFolder,
    as_gray,
    check_folder,
    rows_and_columns,
)
from cvkern.structured_light.patterns import code_bits

CODES = ("gray", "phase")
RESULTS = ("columns.png", "depth.png", "depth.tif", "cloud.ply", "turntable.gif")


def scan(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Photographs under the patterns, in order.")
    ],
    calibration: Annotated[
        Path, typer.Option(metavar="FILE", help="Calibration of the camera and the projector.")
    ],
    output: Folder,
    code: Annotated[str, typer.Option(help="gray, or phase.")] = "gray",
    frequencies: Annotated[
        str, typer.Option(help="Fringes over the projector, of --code phase.")
    ] = "1,8,64",
    steps: Annotated[int, typer.Option(help="Shifts of each fringe.", min=3)] = 4,
    projector: Annotated[
        str | None,
        typer.Option(help="COLUMNSxROWS of the projector.", show_default="from the calibration"),
    ] = None,
    overwrite: OverwriteFolder = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Make a point cloud of photographs of a scene under a projector's patterns.

    Photographs go by the order of their names: those of gray_code_patterns, columns first, each
    pattern before its inverse, with or without rows, and at the end a white and a black one if
    there are; or those of phase_shift_patterns. The first camera of FILE took them, and the second
    is the projector. If it stands above or below, photographs of rows as well are needed, and used.
    DIR has columns.png (or the rows of the projector), depth.png and depth.tif (32-bit floats),
    cloud.ply and turntable.gif.
    """
    from cvkern.clouds import turntable, write_animation, write_ply
    from cvkern.images.colors import apply_colormap
    from cvkern.images.files import read_image, write_image

    if code not in CODES:
        raise ValueError(f"code must be one of {CODES}, got {code!r}")
    if not folder.is_dir():
        raise FileNotFoundError(f"folder must exist, got {str(folder)!r}")
    check_folder(output, RESULTS, overwrite)
    size = None
    if projector is not None:
        size = rows_and_columns(projector, "projector", "1920x1080 say", 1)
    pair = cvkern.read_calibration(calibration, right_shape=size)
    if not isinstance(pair, cvkern.StereoCalibration):
        raise ValueError(f"calibration must be of a camera and a projector, got {calibration}")
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in PHOTOGRAPHS)
    if not files:
        raise ValueError(f"folder must have photographs, got {str(folder)!r}")
    frames = []
    for file in files:
        frames.append(as_gray(read_image(file)))
        if frames[-1].shape != pair.left.shape or frames[-1].dtype != frames[0].dtype:
            raise ValueError(
                f"folder must have photographs of {pair.left.shape} {frames[0].dtype}, got "
                f"{file.name} of {frames[-1].shape} {frames[-1].dtype}"
            )
    with cvkern.use(backend=backend, device=device):
        if code == "gray":
            found, shade = _gray(frames, pair.right.shape)
        else:
            found, shade = _fringes(frames, pair.right.shape, frequencies, steps)
        # Lines across the way from the camera to the projector tell more of the depth.
        across, down = np.abs(pair.translation[:2] * pair.right.matrix[[0, 1], [0, 1]])
        axis = "rows" if found.rows is not None and down > across else "columns"
        lines = getattr(found, axis)
        points = cvkern.triangulate_columns(lines, pair, found.valid, axis=axis)
        known = np.isfinite(points).all(axis=2)
        if not known.any():
            raise ValueError(
                f"no pixel has a depth, and {found.valid.mean():.1%} have a code: are these the "
                "patterns, in this order, and the calibration of this camera and projector?"
            )
        cloud = points[known]
        colors = np.repeat(shade[known][:, None], 3, axis=1)
        movie = turntable(cloud, colors)
    depth = np.where(known, points[..., 2], np.float32(np.nan))
    shown = np.where(found.valid, lines, np.float32(np.nan)).astype(np.float32)
    share = f"{known.mean():.1%} of {depth.shape[0]} x {depth.shape[1]} pixels"
    output.mkdir(parents=True, exist_ok=True)
    write_image(output / "columns.png", apply_colormap(shown, nan=(0, 0, 0)))
    write_image(output / "depth.png", apply_colormap(depth, nan=(0, 0, 0)))
    write_image(output / "depth.tif", depth)
    write_ply(output / "cloud.ply", cloud, colors)
    write_animation(output / "turntable.gif", movie)
    near, far = np.nanmin(depth), np.nanmax(depth)
    typer.echo(f"{output / 'columns.png'}: {share}")
    typer.echo(f"{output / 'depth.tif'}: {near:.6g} to {far:.6g}")
    typer.echo(f"{output / 'cloud.ply'}: {len(cloud)} points")
    typer.echo(f"{output / 'turntable.gif'}: {len(movie)} frames")


def _gray(frames: list[np.ndarray], shape: tuple[int, int]) -> tuple[Any, np.ndarray]:
    """Decode Gray code; return the codes, and how bright the scene is, uint8."""
    columns, rows = 2 * code_bits(shape[1]), 2 * code_bits(shape[0])
    counts = {columns: ("columns",), columns + rows: ("columns", "rows")}
    axes = counts.get(len(frames)) or counts.get(len(frames) - 2)
    if axes is None:
        wanted = " or ".join(f"{n}, {n + 2}" for n in counts)
        raise ValueError(
            f"folder must have {wanted} photographs for a projector of {shape}, got {len(frames)}"
        )
    lights = frames[-2:] if len(frames) not in counts else [None, None]
    stack = np.stack(frames[: len(frames) - (2 if lights[0] is not None else 0)])
    found = cvkern.decode_gray_code(stack, shape, *lights, axes=axes)
    # A pattern and its inverse add up to full light and the room's.
    bright = lights[0] if lights[0] is not None else stack[:2].astype(np.float64).sum(axis=0)
    return found, _bytes(bright)


def _fringes(
    frames: list[np.ndarray], shape: tuple[int, int], frequencies: str, steps: int
) -> tuple[Any, np.ndarray]:
    """Decode fringes; return the places, and how bright the scene is, uint8."""
    try:
        waves = [float(f) for f in frequencies.split(",")]
    except ValueError:
        raise ValueError(f"frequencies must be numbers, got {frequencies!r}") from None
    each = steps * len(waves)
    if len(frames) not in (each, 2 * each):
        raise ValueError(
            f"folder must have {each} or {2 * each} photographs for {len(waves)} frequencies of "
            f"{steps} steps, got {len(frames)}"
        )
    axes = ("columns", "rows")[: len(frames) // each]
    found = cvkern.decode_phase_shift(np.stack(frames), shape, waves, steps, axes=axes)
    return found, _bytes(np.mean(frames[:steps], axis=0))


def _bytes(light: np.ndarray) -> np.ndarray:
    """Return grey values from black to the brightest."""
    light = light.astype(np.float64)
    return np.round(255 * light / max(float(light.max()), 1e-9)).astype(np.uint8)
