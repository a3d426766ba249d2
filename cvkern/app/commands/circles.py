"""``cvkern circles``."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import cvkern
from cvkern.app.commands import (
    Backend,
    Device,
    Drawing,
    High,
    Low,
    Overwrite,
    Photo,
    check_apart,
    check_new,
    write_csv,
)

NAMES = ("row", "column", "radius", "support")
COLOR = (255, 98, 41)


def circles(
    photo: Photo,
    output: Drawing,
    radius: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="LOW HIGH",
            help="Smallest and largest radius, pixels.",
            show_default="1/40 and 1/2 of the shorter side",
        ),
    ] = None,
    sigma: Annotated[
        float | None,
        typer.Option(
            help="Standard deviation of the Gaussian, reduced image's pixels.",
            show_default="a sixth of the smallest radius there, from 1 to 2",
        ),
    ] = None,
    low_threshold: Low = None,
    high_threshold: High = None,
    polarity: Annotated[
        str, typer.Option(help="Bright discs, dark discs, or any: any, bright or dark.")
    ] = "any",
    min_support: Annotated[
        float, typer.Option(help="Share of the circle that must be visible, in (0, 1].")
    ] = 0.5,
    min_distance: Annotated[
        float | None,
        typer.Option(help="Smallest distance between centres, pixels.", show_default="LOW"),
    ] = None,
    to_csv: Annotated[
        Path | None, typer.Option("--csv", help="CSV to write the circles to.")
    ] = None,
    to_json: Annotated[
        Path | None, typer.Option("--json", help="JSON to write the circles to.")
    ] = None,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Find the circles in a photograph, and draw them over it.

    A circle is given by the row and column of its centre, its radius, and its visible share.
    """
    from cvkern._files import replacing, write_text
    from cvkern.images.drawing import draw_circles
    from cvkern.images.files import read_image, write_image

    check_apart((photo,), output=output, csv=to_csv, json=to_json)
    check_new(to_csv, "csv", overwrite)
    check_new(to_json, "json", overwrite)
    image = read_image(photo)
    with cvkern.use(backend=backend, device=device):
        found = cvkern.detect_circles(
            image,
            radius,
            sigma=sigma,
            low_threshold=low_threshold,
            high_threshold=high_threshold,
            polarity=polarity,
            min_support=min_support,
            min_distance=min_distance,
        )
    table = np.column_stack(found)
    with contextlib.ExitStack() as files:  # an error in one file removes all
        if to_csv:
            write_csv(files.enter_context(replacing(to_csv)), ",".join(NAMES), table)
        if to_json:
            rows = [dict(zip(NAMES, row, strict=True)) for row in table.tolist()]
            beside = files.enter_context(replacing(to_json))
            write_text(beside, json.dumps(rows, indent=1) + "\n")
        write_image(output, draw_circles(image, table[:, :3], color=COLOR, width=2.0))
    typer.echo(f"{output}: {len(table)} circles")
    for row, column, size, support in table.tolist():
        typer.echo(f"row {row:.1f}, column {column:.1f}, radius {size:.1f}, support {support:.2f}")
