"""``cvkern calibrate``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import cvkern
from cvkern.app.commands import (
    PHOTOGRAPHS,
    Backend,
    Device,
    Overwrite,
    check_new,
    progress_bar,
    rows_and_columns,
)
from cvkern.geometry.cameras.calibration import PARAMETERS, free_of


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

    With --right, photographs are a pair whose names have the same text in place of the * of both
    patterns; if no names do, the first in the order of names are a pair, the second, and so on.
    Photographs that cannot be read, have another size than most or show no whole board are named
    and left out. FILE is JSON, or YAML as OpenCV writes it.
    """
    from cvkern._files import check_target

    shape = rows_and_columns(board, "board", "9x6 say, each at least 2", 2)
    names = [name for name in fixed.replace(",", " ").split() if name]
    need = max(1, -(-int(free_of(names)[:4].sum()) // 2))
    if output.suffix.lower() not in (".json", ".yml", ".yaml"):
        raise ValueError(f"output must end in .json, .yml or .yaml, got {str(output)!r}")
    check_target(output)
    check_new(output, "output", overwrite)
    sides = [_files(folder, left)]
    if right:
        sides = _paired(sides[0], _files(folder, right), left, right)
    with cvkern.use(backend=backend, device=device):
        seen, sizes = _detected(sides, shape, board)
    views = list(zip(*seen, strict=True))
    good = [n for n, pair in enumerate(views) if all(p is not None for p in pair)]
    if len(good) < need:
        of = "pairs" if right else "photographs"
        found = ", ".join(" and ".join(files[n].name for files in sides) for n in good)
        raise ValueError(
            f"board must be seen as a whole, {board} corners where four squares meet, in at least "
            f"{need} {of}, got {len(good)} of {len(views)}" + (f": {found}" if good else "")
        )
    points = cvkern.chessboard_points(shape, square)
    lists: list[list[Any]] = [[found[n] for n in good] for found in seen]
    said = f"{len(good)} of {len(views)} "
    try:
        if right:
            found = cvkern.calibrate_stereo(
                points, lists[0], lists[1], sizes[0], right_shape=sizes[1], fixed=names
            )
            said += f"pairs, {found.rms:.3f} px; {_said_of_pair(found, lists)}"
        else:
            found = cvkern.calibrate_camera(points, lists[0], sizes[0], fixed=names)
            for n, rms in zip(good, found.view_rms, strict=True):
                typer.echo(f"{sides[0][n].name}: {rms:.3f} px")
            said += f"photographs, {found.rms:.3f} px; {_said_of_camera(found)}"
    except ValueError as error:
        raise ValueError(
            f"board must be tilted in different ways to give a camera, got {len(good)} views that "
            f"do not: {error}"
        ) from error
    cvkern.write_calibration(output, found)
    typer.echo(f"{output}: {said}")


def _said_of_camera(found: cvkern.Calibration) -> str:
    fx, fy, cx, cy = found.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    spread = found.deviations
    return (
        f"fx {fx:.2f} +- {spread[0]:.2f}, fy {fy:.2f} +- {spread[1]:.2f}, "
        f"cx {cx:.2f} +- {spread[2]:.2f}, cy {cy:.2f} +- {spread[3]:.2f}"
    )


def _said_of_pair(found: cvkern.StereoCalibration, lists: list[list[Any]]) -> str:
    rectified = cvkern.rectify_stereo(found)
    pairs = [rectified.points(a, b) for a, b in zip(*lists, strict=True)]
    gap = np.mean([np.abs(a[:, 0] - b[:, 0]).mean() for a, b in pairs])
    return f"baseline {rectified.baseline:.6g}; rows of rectified corners differ by {gap:.3f} px"


def _files(folder: Path, names: str) -> list[Path]:
    """Return the photographs of a folder in the order of their names."""
    if not folder.is_dir():
        raise FileNotFoundError(f"folder must exist, got {str(folder)!r}")
    found = sorted(p for p in folder.glob(names) if p.suffix.lower() in PHOTOGRAPHS and p.is_file())
    if not found:
        raise ValueError(f"folder must have photographs named {names}, got {str(folder)!r}")
    return found


def _paired(lefts: list[Path], rights: list[Path], left: str, right: str) -> list[list[Path]]:
    """Return the photographs of both cameras that are pairs; name those without a partner."""
    keys = [{_wild(f.name, glob): f for f in files} for files, glob in
            ((lefts, left), (rights, right))]  # fmt: skip
    both = [key for key in keys[0] if key and key in keys[1]]
    if both:
        for mine, other in (keys, keys[::-1]):
            for key, file in mine.items():
                if key not in other:
                    typer.echo(f"{file.name}: no partner")
        return [[side[key] for key in both] for side in keys]
    if len(lefts) != len(rights):
        raise ValueError(
            f"left and right must match as many photographs, got {len(lefts)} and {len(rights)}"
        )
    return [lefts, rights]


def _wild(name: str, glob: str) -> str:
    """Return the parts of a name that match the wildcards of a pattern."""
    pattern = re.escape(Path(glob).name).replace(r"\*", "(.*)").replace(r"\?", "(.)")
    found = re.fullmatch(pattern, name)
    return "/".join(found.groups()) if found else ""


def _detected(
    sides: list[list[Path]], shape: tuple[int, int], board: str
) -> tuple[list[list[np.ndarray | None]], list[tuple[int, int]]]:
    """Return the corners in all photographs, and the size of each camera's; name those without."""
    from cvkern.images.files import read_image

    every, sizes = [], []
    with progress_bar() as bar:
        task = bar.add_task("", total=sum(map(len, sides)))
        for files in sides:
            found: list[np.ndarray | None] = []
            shapes: list[tuple[int, int] | None] = []
            for file in files:
                bar.update(task, description=file.name)
                corners, size = None, None
                try:
                    image = read_image(file)
                    size = image.shape[0], image.shape[1]
                    corners = cvkern.detect_chessboard(image, shape)
                except ValueError as error:
                    typer.echo(f"{file.name}: left out: {error}")
                else:
                    if corners is None:
                        typer.echo(f"{file.name}: no whole board of {board} corners")
                found.append(corners)
                shapes.append(size if corners is not None else None)
                bar.advance(task)
            seen = [s for s in shapes if s]
            size = max(seen, key=seen.count, default=(1, 1))
            for n, (file, other) in enumerate(zip(files, shapes, strict=True)):
                if other not in (None, size):
                    typer.echo(f"{file.name}: left out: its size is {other}, that of most {size}")
                    found[n] = None
            every.append(found)
            sizes.append(size)
    return every, sizes
