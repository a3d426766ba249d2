"""``cvkern lines``."""

from __future__ import annotations

import contextlib
import json
from typing import Annotated

import numpy as np
import typer

import cvkern
from cvkern.app.commands import (
    Backend,
    Csv,
    Device,
    Drawing,
    High,
    Json,
    Low,
    Overwrite,
    Photo,
    check_apart,
    check_new,
    write_csv,
)

SEGMENT = ("row", "column", "to_row", "to_column")
LINE = ("theta", "rho", "votes")
COLOR = (255, 98, 41)


def lines(
    photo: Photo,
    output: Drawing,
    whole: Annotated[
        bool, typer.Option("--lines/--segments", help="Whole lines, or segments with two ends.")
    ] = False,
    sigma: Annotated[float, typer.Option(help="Standard deviation of the Gaussian, pixels.")] = 1.0,
    low_threshold: Low = None,
    high_threshold: High = None,
    min_length: Annotated[float, typer.Option(help="Smallest length of a segment, pixels.")] = 20.0,
    max_gap: Annotated[float, typer.Option(help="Largest gap in a segment, pixels.")] = 3.0,
    min_votes: Annotated[
        float | None,
        typer.Option(help="Fewest edge points of a line.", show_default="a tenth of the diagonal"),
    ] = None,
    to_csv: Csv = None,
    to_json: Json = None,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Find the straight lines in a photograph, and draw them over it.

    A segment is given by the row and column of each end. A line is given by the angle of its normal
    in degrees, its distance from the first pixel, and the number of edge points on it.
    """
    from cvkern._files import replacing, write_text
    from cvkern.images._overlay import across
    from cvkern.images.drawing import draw_lines
    from cvkern.images.files import read_image, write_image

    check_apart((photo,), output=output, csv=to_csv, json=to_json)
    check_new(to_csv, "csv", overwrite)
    check_new(to_json, "json", overwrite)
    image = read_image(photo)
    thresholds = (sigma, low_threshold, high_threshold)
    with cvkern.use(backend=backend, device=device):
        if whole:
            found = cvkern.detect_lines(image, *thresholds, min_votes=min_votes)
            table = np.column_stack((np.degrees(found.theta), found.rho, found.votes))
            drawn = across(found.theta, found.rho, image.shape[:2])
        else:
            drawn = table = cvkern.detect_segments(
                image, *thresholds, min_length=min_length, max_gap=max_gap
            )
    columns = LINE if whole else SEGMENT
    with contextlib.ExitStack() as files:  # an error in one file removes all
        if to_csv:
            write_csv(files.enter_context(replacing(to_csv)), ",".join(columns), table)
        if to_json:
            rows = [dict(zip(columns, row, strict=True)) for row in table.tolist()]
            beside = files.enter_context(replacing(to_json))
            write_text(beside, json.dumps(rows, indent=1) + "\n")
        write_image(output, draw_lines(image, drawn, color=COLOR, width=2.0))
    typer.echo(f"{output}: {len(table)} {'lines' if whole else 'segments'}")
