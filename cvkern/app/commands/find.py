"""``cvkern find``."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import cvkern
from cvkern.app.commands import (
    Backend,
    Device,
    Drawing,
    Overwrite,
    check_apart,
    check_new,
    write_csv,
)

COLOR = (255, 98, 41)
FRAME = (255, 214, 64)


def find(
    template: Annotated[
        Path, typer.Argument(metavar="TEMPLATE", help="Image that shows mainly the shape.")
    ],
    scene: Annotated[
        Path, typer.Argument(metavar="SCENE", help="Image to find it in, or a folder of them.")
    ],
    output: Drawing,
    rotations: Annotated[
        int, typer.Option(help="Rotations to try, over the full turn; 1 for upright only.")
    ] = 360,
    scales: Annotated[
        tuple[float, float, float], typer.Option(metavar="LOW HIGH STEP", help="Sizes to try.")
    ] = (0.8, 1.6, 0.05),
    num_peaks: Annotated[int, typer.Option(help="Largest number of shapes to find.")] = 1,
    threshold: Annotated[
        float, typer.Option(help="Share of the outline that must be found, in [0, 1].")
    ] = 0.25,
    sigma: Annotated[float, typer.Option(help="Standard deviation of the Gaussian, pixels.")] = 1.0,
    to_csv: Annotated[Path | None, typer.Option("--csv", help="CSV to write the poses to.")] = None,
    to_json: Annotated[
        Path | None, typer.Option("--json", help="JSON to write the poses to.")
    ] = None,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Find a shape in a photograph, rotated, scaled, partly hidden (generalised Hough transform).

    Draws the outline of TEMPLATE over SCENE. A pose is the row and column of the template's centre,
    the rotation in degrees, clockwise, and the scale. Its votes, and the share of its outline that
    has edges in place, are given as well.
    """
    from cvkern._files import replacing, write_text
    from cvkern.images.files import read_image, write_image

    check_apart((template, scene), output=output, csv=to_csv, json=to_json)
    check_new(to_csv, "csv", overwrite)
    check_new(to_json, "json", overwrite)
    low, high, step = scales
    if not (0 < low <= high and step > 0):
        raise ValueError(
            f"scales must be LOW <= HIGH and a STEP, all > 0, got {low:g} {high:g} {step:g}"
        )
    sizes = low + step * np.arange(int((high - low) / step + 1e-6) + 1)
    image, shape = read_image(scene), read_image(template)
    with cvkern.use(backend=backend, device=device):
        table = cvkern.r_table(shape, sigma=sigma)
        found = cvkern.generalized_hough(
            image, table, rotations=rotations, scales=sizes, num_peaks=num_peaks,
            threshold=threshold, sigma=sigma,
        )  # fmt: skip
    degrees = np.degrees(found.rotation)
    columns = (found.position, degrees, found.scale, found.votes, found.support)
    with contextlib.ExitStack() as files:  # an error in one file removes all
        if to_csv:
            beside = files.enter_context(replacing(to_csv))
            write_csv(beside, "row,column,rotation,scale,votes,support", *columns)
        if to_json:
            write_text(files.enter_context(replacing(to_json)), _as_json(columns))
        write_image(output, _drawn(image, table, found))
    typer.echo(f"{output}: found {len(found.votes)} of {template.name}")
    for (row, column), degree, scale, votes, support in zip(*columns, strict=True):
        typer.echo(
            f"row {row:.1f}, column {column:.1f}, rotation {degree:.1f} degrees, "
            f"scale {scale:.3f}, {votes} votes, support {support:.2f}"
        )


def _as_json(columns: tuple[np.ndarray, ...]) -> str:
    position, *others = (a.tolist() for a in columns)
    names = ("row", "column", "rotation", "scale", "votes", "support")
    rows = [
        dict(zip(names, (*place, *rest), strict=True))
        for place, *rest in zip(position, *others, strict=True)
    ]
    return json.dumps(rows, indent=1) + "\n"


def _drawn(image: np.ndarray, table: cvkern.RTable, found: Any) -> np.ndarray:
    """Return the scene with the outline and the frame of each shape found."""
    from cvkern.hough.generalized._poses import placed
    from cvkern.images.drawing import draw_lines, draw_points

    last = np.array(table.shape) - 1
    corners = np.array([[0, 0], [0, 1], [1, 1], [1, 0]]) * last - table.reference
    for position, rotation, scale in zip(*found[:3], strict=True):
        frame = placed(corners, position, float(rotation), float(scale))
        image = draw_lines(image, np.hstack((frame, np.roll(frame, -1, axis=0))), color=FRAME)
        outline = placed(-table.vectors, position, float(rotation), float(scale))
        image = draw_points(image, outline, color=COLOR, radius=1.0)
    return image
