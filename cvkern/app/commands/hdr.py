"""``cvkern hdr``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import cvkern
from cvkern.app.commands import Backend, Device, Overwrite, Picture, check_apart, check_new
from cvkern.images._exif import EXIF

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
TIMES = "exposure_seconds.json"
EXPOSURE_TIME = 0x829A  # tag of EXIF, in seconds


def hdr(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of the exposures.")],
    output: Picture,
    seconds: Annotated[
        str | None,
        typer.Option(
            help="Times in the order of the names, as 1/60,1/15,1/4.",
            show_default=f"{TIMES} in the folder, or those that the camera wrote",
        ),
    ] = None,
    tone: Annotated[
        str,
        typer.Option(
            help="reinhard, reinhard_local, bilateral, local_laplacian, or fuse for no radiance."
        ),
    ] = "reinhard_local",
    align: Annotated[bool, typer.Option("--align", help="Align the exposures first.")] = False,
    radiance: Annotated[
        Path | None, typer.Option(help="NumPy file to write the radiance to.")
    ] = None,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Merge exposures of a scene, and show all of it in one picture.

    The curve of the camera is estimated from images of 8 bits; those of 16 bits are taken to be
    linear. With `--tone fuse` no times are needed, and all images are fused as they look.
    """
    from cvkern.images.files import read_image, write_image
    from cvkern.raw.exposures import check_order

    if not folder.is_dir():
        raise ValueError(f"FOLDER must be a folder, got {str(folder)!r}")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    if len(paths) < 2:
        raise ValueError(f"FOLDER must have at least 2 images, got {len(paths)}")
    check_apart(paths, output=output, radiance=radiance)
    check_new(radiance, "radiance", overwrite)
    if tone == "fuse" and radiance:
        raise ValueError("radiance must go with another tone than 'fuse'")
    images = [np.asarray(read_image(path)) for path in paths]
    images = [image[..., :3] if image.ndim == 3 else image for image in images]
    _check_alike(paths, images)
    with cvkern.use(backend=backend, device=device):
        if align:
            images = cvkern.align_exposures(images).images
        if tone == "fuse":
            picture = cvkern.fuse_exposures(images)
            shown = np.rint(picture * 255).astype(np.uint8)
        else:
            times = _times(seconds, folder, paths)
            if len(times) == len(images):
                check_order(np.array(times), images)
            merged = cvkern.merge_exposures(images, times)
            linear = cvkern.tone_map(merged, tone)
            colours = linear if linear.ndim == 3 else np.stack([linear] * 3, axis=-1)
            shown = cvkern.convert_color(colours, "rgb", "srgb", dtype="uint8")
            if radiance:
                from cvkern._files import replacing

                with replacing(radiance) as beside, beside.open("wb") as file:
                    np.save(file, merged)
    write_image(output, shown)
    typer.echo(f"{output}: {len(paths)} exposures of {shown.shape[0]} x {shown.shape[1]}")


def _check_alike(paths: list[Path], images: list[np.ndarray]) -> None:
    """Refuse an image whose shape is not that of most."""
    shapes = [image.shape for image in images]
    usual = max(shapes, key=shapes.count)
    for path, shape in zip(paths, shapes, strict=True):
        if shape != usual:
            raise ValueError(f"images must have one shape, {usual}, got {shape} of {path.name}")


def _taken(path: Path) -> float | None:
    """Return the exposure time that a camera wrote into a file."""
    from PIL import Image

    with Image.open(path) as image:
        time = image.getexif().get_ifd(EXIF).get(EXPOSURE_TIME)
    try:
        return float(time) if time is not None else None
    except (TypeError, ValueError, ZeroDivisionError):
        return None


def _times(seconds: str | None, folder: Path, paths: list[Path]) -> list[float]:
    """Return the time of each image: as told, from a file in the folder, or from the images."""
    if seconds is None:
        file = folder / TIMES
        if not file.is_file():
            taken = [time for time in map(_taken, paths) if time]
            if len(taken) == len(paths):
                return taken
            raise ValueError(
                f"seconds must be given, or {TIMES} be in the folder, or times in the images, "
                "got neither"
            )
        try:
            table = dict(json.loads(file.read_text(encoding="utf-8")))
        except (ValueError, TypeError, RecursionError) as error:
            raise ValueError(f"{TIMES} must have a time for each image: {error}") from None
        for path in paths:
            time = table.get(path.name)
            if isinstance(time, bool) or not isinstance(time, (int, float)):
                raise ValueError(
                    f"{TIMES} must have a time for each image, got {time} for {path.name}"
                )
        return [table[path.name] for path in paths]
    try:
        parts = [part.split("/") for part in seconds.split(",")]
        return [float(p[0]) / float(p[1]) if len(p) == 2 else float(p[0]) for p in parts]
    except (ValueError, ZeroDivisionError):
        raise ValueError(f"seconds must be numbers or fractions, got {seconds!r}") from None
