"""``cvkern match``."""

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
    Csv,
    Device,
    Json,
    Overwrite,
    Picture,
    as_gray,
    check_apart,
    check_new,
    write_csv,
)

COLUMNS = ("row", "column", "to_row", "to_column")
COLOR = (255, 98, 41)
MOST_DRAWN = 200


def match(
    one: Annotated[Path, typer.Argument(metavar="A", help="Image to read.")],
    other: Annotated[Path, typer.Argument(metavar="B", help="Image to match it with.")],
    output: Picture,
    method: Annotated[str, typer.Option(help="sift, or orb.")] = "sift",
    max_keypoints: Annotated[int, typer.Option(help="Points of each image.", min=1)] = 2000,
    max_ratio: Annotated[
        float, typer.Option(help="Largest ratio of best to second distance; 1 keeps all.")
    ] = 0.8,
    plane: Annotated[
        bool,
        typer.Option("--plane", help="Both show a plane, or were taken from one place: find more."),
    ] = False,
    spread: Annotated[bool, typer.Option("--spread", help="Spread the points evenly.")] = False,
    to_csv: Csv = None,
    to_json: Json = None,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Match the keypoints of two photographs, and draw the matches between them.

    A match is the row and column of a point in A, and of the same point in B. The picture shows
    both photographs side by side, with lines between at most 200 matches, spread over all of them.
    """
    from cvkern._files import replacing, write_text
    from cvkern._whites import white_of
    from cvkern.images.files import read_image, write_image

    check_apart((one, other), output=output, csv=to_csv, json=to_json)
    check_new(to_csv, "csv", overwrite)
    check_new(to_json, "json", overwrite)
    if method not in ("sift", "orb"):
        raise ValueError(f"method must be one of ('sift', 'orb'), got {method!r}")
    if plane and (method != "sift" or spread):
        raise ValueError("plane must be used with method sift and without spread, got others")
    images = [read_image(file) for file in (one, other)]
    whites = [white_of(image) for image in images]
    with cvkern.use(backend=backend, device=device):
        if plane:
            # One dtype for both, in parts of white.
            a, b = (
                as_gray(i).astype(np.float32) / np.float32(w)
                for i, w in zip(images, whites, strict=True)
            )
            matches = cvkern.match_photographs(
                a, b, max_keypoints=max_keypoints, max_ratio=max_ratio
            )
            table = np.hstack((matches.points0, matches.points1))
            told = f"{len(table)} matches of one homography"
        else:
            find = getattr(cvkern, method)
            found = [
                find(as_gray(i), max_keypoints, spread=spread, data_range=w)
                for i, w in zip(images, whites, strict=True)
            ]
            metric = "euclidean" if method == "sift" else "hamming"
            pairs = cvkern.match_descriptors(
                found[0].descriptors, found[1].descriptors, max_ratio, metric=metric
            )
            table = np.hstack([f.points[pairs[:, i]] for i, f in enumerate(found)])
            told = "{} matches of {} and {} points".format(
                len(table), *(len(f.points) for f in found)
            )
    with contextlib.ExitStack() as files:  # an error in one file removes all
        if to_csv:
            write_csv(files.enter_context(replacing(to_csv)), ",".join(COLUMNS), table)
        if to_json:
            rows = [dict(zip(COLUMNS, row, strict=True)) for row in table.tolist()]
            beside = files.enter_context(replacing(to_json))
            write_text(beside, json.dumps(rows, indent=1) + "\n")
        write_image(output, side_by_side(images, table))
    typer.echo(f"{output}: {told}")


def side_by_side(images: list[np.ndarray], table: np.ndarray) -> np.ndarray:
    """Draw two images side by side, with lines between some of their matches."""
    from cvkern._whites import white_of
    from cvkern.images.drawing import draw_lines

    parts = []
    for image in images:
        part = image[..., :3] if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
        part = part.astype(np.float64) * (255 / white_of(image))
        parts.append(part.clip(0, 255).round().astype(np.uint8))
    height, left = max(len(p) for p in parts), parts[0].shape[1]
    canvas = np.zeros((height, left + parts[1].shape[1], 3), np.uint8)
    canvas[: len(parts[0]), :left] = parts[0]
    canvas[: len(parts[1]), left:] = parts[1]
    drawn = table[:: max(1, -(-len(table) // MOST_DRAWN))] + np.array([0, 0, 0, left])
    return draw_lines(canvas, drawn, color=COLOR, width=1.0)
