"""``cvkern recognize``: learn objects of a class from pictures, and find them in a photograph."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from typer.core import TyperGroup

import cvkern
from cvkern.app.commands import (
    PHOTOGRAPHS,
    Backend,
    Device,
    Overwrite,
    check_apart,
    check_new,
    write_csv,
)

FRAME = (255, 214, 64)
BOXES = "boxes.json"


class _Group(TyperGroup):
    """A group whose command is ``find`` unless the first argument names another."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] != "--help":
            args = ["find", *args]
        return super().parse_args(ctx, args)


recognize = typer.Typer(
    cls=_Group,
    help="Objects of a class: learn them from pictures, and find them in a photograph.\n\n"
    "cvkern recognize train FOLDER -o MODEL, then cvkern recognize MODEL PHOTO -o OUT.",
    no_args_is_help=True,
)


@recognize.command()
def train(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of pictures.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="MODEL", help="Model to write, .npz.")
    ],
    words: Annotated[int, typer.Option(help="Number of visual words.")] = 1000,
    patch: Annotated[int, typer.Option(help="Side of a patch, pixels of the model.")] = 16,
    step: Annotated[int, typer.Option(help="Pixels between patches.")] = 4,
    points: Annotated[str, typer.Option(help="grid, harris or dog.")] = "grid",
    size: Annotated[
        int | None,
        typer.Option(
            help="Longer side of the model's box, pixels.", show_default="the median, at most 96"
        ),
    ] = None,
    mirror: Annotated[bool, typer.Option(help="Learn from mirrored objects too.")] = True,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Learn from the pictures of a folder, and write a model.

    Each picture shows one object, or as many as the file boxes.json says: it has, for the name of
    each picture, a list of boxes [first row, first column, row behind the last, column behind the
    last]. The folder "negatives" has pictures without objects; the folder "masks", for each
    picture, one of its name that is not black where objects are.
    """
    if not folder.is_dir():
        raise ValueError(f"folder must be a folder that exists, got {str(folder)!r}")
    check_new(output, "output", overwrite)
    files = _pictures(folder)
    if not files:
        raise ValueError(f"folder must have pictures, got none in {str(folder)!r}")
    images = [_read(file) for file in files]
    boxes = _boxes(folder / BOXES, files)
    masks = None
    if (folder / "masks").is_dir():
        named = {file.stem: file for file in _pictures(folder / "masks")}
        missing = [file.name for file in files if file.stem not in named]
        if missing:
            raise ValueError(f"masks must have one for each picture, got none for {missing[0]!r}")
        masks = [_flat(_read(named[file.stem])) for file in files]
    negatives = [_read(file) for file in _pictures(folder / "negatives")]
    with cvkern.use(backend=backend, device=device):
        model = cvkern.ShapeModel(
            words, patch=patch, step=step, points=points, size=size, mirror=mirror
        )
        model.fit(images, boxes, masks, negatives or None)
    model.save(output)
    count = len(files) if boxes is None else sum(map(len, boxes))
    height, width = model.box or (0, 0)
    typer.echo(
        f"{output}: learnt {count} objects against {len(negatives)} negatives; "
        f"at scale 1 an object has {height} x {width} pixels"
    )


@recognize.command(hidden=True)
def find(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="Model to read, .npz.")],
    photo: Annotated[Path, typer.Argument(metavar="PHOTO", help="Photograph to search.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="OUT", help="Picture to write.")
    ],
    scales: Annotated[
        str | None,
        typer.Option(
            metavar="S,S,...",
            help="Sizes of objects, in sizes of the model.",
            show_default="0.71 to 1.41 times that of the pictures learnt from",
        ),
    ] = None,
    threshold: Annotated[
        float | None, typer.Option(help="Least score.", show_default="the model's")
    ] = None,
    to_csv: Annotated[Path | None, typer.Option("--csv", help="CSV to write objects to.")] = None,
    to_json: Annotated[
        Path | None, typer.Option("--json", help="JSON to write objects to.")
    ] = None,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Find objects in a photograph: cvkern recognize MODEL PHOTO -o OUT.

    Their boxes are drawn. If the model was learnt with masks, their pixels are tinted too.
    """
    from cvkern._files import replacing, write_text
    from cvkern.images.files import write_image

    check_apart((model, photo), output=output, csv=to_csv, json=to_json)
    check_new(to_csv, "csv", overwrite)
    check_new(to_json, "json", overwrite)
    sizes = None if scales is None else _numbers(scales)
    known, image = cvkern.ShapeModel.load(model), _read(photo)
    with cvkern.use(backend=backend, device=device):
        if known.has_masks:
            found, masks = known.segment(image, scales=sizes, threshold=threshold)
            image = tinted(image, masks)
        else:
            found = known.detect(image, scales=sizes, threshold=threshold)
    with contextlib.ExitStack() as files:  # an error in one file removes all
        columns = (found.boxes, found.scores, found.scales)
        if to_csv:
            beside = files.enter_context(replacing(to_csv))
            write_csv(beside, "row,column,end_row,end_column,score,scale", *columns)
        if to_json:
            rows = [
                {"box": box, "score": score, "scale": scale}
                for box, score, scale in zip(*(a.tolist() for a in columns), strict=True)
            ]
            write_text(files.enter_context(replacing(to_json)), json.dumps(rows, indent=1) + "\n")
        write_image(output, drawn(image, found))
    typer.echo(f"{output}: found {len(found.boxes)}")
    for box, score, scale in zip(*columns, strict=True):
        top, left, bottom, right = box
        typer.echo(
            f"rows {top:.0f} to {bottom:.0f}, columns {left:.0f} to {right:.0f}, "
            f"score {score:.2f}, scale {scale:.2f}"
        )


def drawn(image: np.ndarray, found: Any) -> np.ndarray:
    """Return a picture with the boxes of the objects that were found."""
    from cvkern.images.drawing import draw_lines

    for top, left, bottom, right in found.boxes - 0.5:
        corners = np.array([[top, left], [top, right], [bottom, right], [bottom, left]])
        image = draw_lines(image, np.hstack((corners, np.roll(corners, -1, axis=0))), color=FRAME)
    return image


def tinted(image: np.ndarray, masks: np.ndarray) -> np.ndarray:
    """Return a picture whose pixels of objects are mixed with the colour of their frames."""
    shown = masks.any(axis=0)
    image = np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image.copy()
    color = np.array(FRAME) * (int(np.iinfo(image.dtype).max) // 255)
    image[shown, :3] = image[shown, :3] // 2 + (color // 2).astype(image.dtype)
    return image


def _pictures(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(p for p in folder.iterdir() if p.suffix.lower() in PHOTOGRAPHS and p.is_file())


def _read(file: Path) -> np.ndarray:
    from cvkern.images.files import read_image

    return read_image(file)


def _flat(mask: np.ndarray) -> np.ndarray:
    return mask if mask.ndim == 2 else mask[..., :3].max(axis=-1)


def _boxes(file: Path, pictures: list[Path]) -> list[list[list[float]]] | None:
    """Return the boxes of each picture, if there is a file of them."""
    if not file.is_file():
        return None
    try:
        given = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{BOXES} must be JSON, got {str(file)!r}: {error}") from None
    names = {picture.name for picture in pictures}
    if not isinstance(given, dict) or not set(given) <= names:
        raise ValueError(f"{BOXES} must have names of pictures, got others in {str(file)!r}")
    return [given.get(picture.name, []) for picture in pictures]


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ValueError(f"scales must be numbers with commas, got {text!r}") from None
