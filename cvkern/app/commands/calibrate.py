"""``cvkern calibrate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import cvkern
from cvkern.app.commands import PHOTOGRAPHS, Backend, Device, Overwrite, check_new, progress_bar
from cvkern.geometry.cameras.calibration import PARAMETERS


def calibrate(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Photographs of a chessboard.")],
    board: Annotated[
        str, typer.Option(help="COLUMNSxROWS of inner corners, where four squares meet.")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="JSON or YAML file to write.")
    ],
    square: Annotated[
        float, typer.Option(help="Side of a square; gives distances their unit.")
    ] = 1.0,
    left: Annotated[
        str, typer.Option(metavar="GLOB", help="Names of the photographs, or of the left camera's.")
    ] = "*",
    right: Annotated[
        str | None, typer.Option(metavar="GLOB", help="Names of those of the right camera.")
    ] = None,
    fixed: Annotated[
        str,
        typer.Option(help=f"What stays 0, or in the middle, with commas: {' '.join(PARAMETERS)}."),
    ] = "",
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Find a camera, or a pair of cameras, from photographs of a chessboard.

    Photographs go by the order of their names; with --right the first of both cameras are a pair,
    the second, and so on. Those without a whole board are left out. FILE is JSON, or YAML as
    OpenCV writes it.
    """
    from cvkern._files import check_target

    shape = _board(board)
    names = [name for name in fixed.replace(",", " ").split() if name]
    if output.suffix.lower() not in (".json", ".yml", ".yaml"):
        raise ValueError(f"output must end in .json, .yml or .yaml, got {str(output)!r}")
    check_target(output)
    check_new(output, "output", overwrite)
    sides = [_files(folder, left)] + ([_files(folder, right)] if right else [])
    if len({len(files) for files in sides}) > 1:
        raise ValueError(
            f"left and right must match as many photographs, got {len(sides[0])} and "
            f"{len(sides[1])}"
        )
    points = cvkern.chessboard_points(shape, square)
    with cvkern.use(backend=backend, device=device):
        seen, size = _detected(sides, shape)
    views = list(zip(*seen, strict=True))
    good = [n for n, pair in enumerate(views) if all(p is not None for p in pair)]
    for n, pair in enumerate(views):
        missing = [files[n].name for files, p in zip(sides, pair, strict=True) if p is None]
        if missing:
            typer.echo(f"{' and '.join(missing)}: no whole board of {board} corners")
    if not good:
        raise ValueError(f"board must be seen as a whole in some photographs, got none: {board}")
    lists = [[found[n] for n in good] for found in seen]
    if right:
        found = cvkern.calibrate_stereo(points, lists[0], lists[1], size, fixed=names)
        rectified = cvkern.rectify_stereo(found)
        pairs = [rectified.points(a, b) for a, b in zip(*lists, strict=True)]
        gap = np.mean([np.abs(a[:, 0] - b[:, 0]).mean() for a, b in pairs])
        said = (
            f"{len(good)} of {len(views)} pairs, {found.rms:.3f} px; baseline "
            f"{rectified.baseline:.6g}; rows of rectified corners differ by {gap:.3f} px"
        )
    else:
        found = cvkern.calibrate_camera(points, lists[0], size, fixed=names)
        for n, rms in zip(good, found.view_rms, strict=True):
            typer.echo(f"{sides[0][n].name}: {rms:.3f} px")
        fx, fy, cx, cy = found.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
        spread = found.deviations
        said = (
            f"{len(good)} of {len(views)} photographs, {found.rms:.3f} px; "
            f"fx {fx:.2f} +- {spread[0]:.2f}, fy {fy:.2f} +- {spread[1]:.2f}, "
            f"cx {cx:.2f} +- {spread[2]:.2f}, cy {cy:.2f} +- {spread[3]:.2f}"
        )
    cvkern.write_calibration(output, found)
    typer.echo(f"{output}: {said}")


def _board(board: str) -> tuple[int, int]:
    """Return rows and columns of COLUMNSxROWS."""
    parts = board.lower().split("x")
    if len(parts) != 2 or not all(part.isdecimal() and int(part) >= 2 for part in parts):
        raise ValueError(f"board must be COLUMNSxROWS, 9x6 say, each at least 2, got {board!r}")
    return int(parts[1]), int(parts[0])


def _files(folder: Path, names: str) -> list[Path]:
    """Return the photographs of a folder in the order of their names."""
    if not folder.is_dir():
        raise FileNotFoundError(f"folder must exist, got {str(folder)!r}")
    found = sorted(p for p in folder.glob(names) if p.suffix.lower() in PHOTOGRAPHS and p.is_file())
    if not found:
        raise ValueError(f"folder must have photographs named {names}, got {str(folder)!r}")
    return found


def _detected(
    sides: list[list[Path]], shape: tuple[int, int]
) -> tuple[list[list[np.ndarray | None]], tuple[int, int]]:
    """Return the corners in all photographs, and their size."""
    from cvkern.images.files import read_image

    size: tuple[int, int] | None = None
    seen: list[list[np.ndarray | None]] = []
    with progress_bar() as bar:
        task = bar.add_task("", total=sum(map(len, sides)))
        for files in sides:
            found: list[np.ndarray | None] = []
            for file in files:
                bar.update(task, description=file.name)
                image = read_image(file)
                if size not in (None, image.shape[:2]):
                    raise ValueError(
                        f"{file}: photographs must have one size, {size}, got {image.shape[:2]}"
                    )
                size = image.shape[0], image.shape[1]
                found.append(cvkern.detect_chessboard(image, shape))
                bar.advance(task)
            seen.append(found)
    assert size is not None
    return seen, size
