"""``cvkern panorama``."""

from __future__ import annotations

import json
import math
import re
import shutil
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import cvkern
from cvkern.app.commands import PHOTOGRAPHS, Backend, Device, progress_bar
from cvkern.panorama.stitching import MAX_PIXELS

WRITTEN = re.compile(r"panorama-\d+(-mask)?\.(png|tif|npy|zarr)")
REPORT = "report.json"


def panorama(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of photographs.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder to write.")],
    surface: Annotated[str, typer.Option(help="auto, plane, cylinder or sphere.")] = "auto",
    scale: Annotated[
        float, typer.Option(help="Pixels of a panorama in one of a photograph.")
    ] = 1.0,
    crop: Annotated[
        bool, typer.Option("--crop", help="Cut to the largest rectangle without gaps.")
    ] = False,
    compensate: Annotated[
        bool, typer.Option(help="Make the exposures of the photographs alike.")
    ] = True,
    focal: Annotated[
        float | None,
        typer.Option(help="Focal length of all, pixels.", show_default="EXIF, where there is one"),
    ] = None,
    max_pixels: Annotated[int, typer.Option(help="Largest panorama.")] = MAX_PIXELS,
    large: Annotated[
        str | None,
        typer.Option(help="Form of panoramas that may exceed memory: .tif, .npy or .zarr."),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the panoramas that DIR has.")
    ] = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Make every panorama of a folder of photographs, whatever their order.

    DIR is made if missing. Each panorama is panorama-N.png, the one of most photographs first
    (.tif for photographs of floats); report.json has which photographs show the same, the
    strangers, and of each panorama its members, model, surface, focal lengths in pixels, rotations,
    lens, gains and the residual of its matches. Photographs are turned as their EXIF orientation
    asks. A file that cannot be read is left out, with a message; photographs of another dtype than
    most become photographs of that one, and white stays white.

    With --large, neither the photographs nor the panoramas need fit into memory: tiles are written
    into panorama-N and panorama-N-mask of that form. A run that was killed goes on when the same
    command is given again.
    """
    from cvkern.images._exif import focal_length
    from cvkern.images.files import read_image, write_image

    if not folder.is_dir():
        raise ValueError(f"folder must be a folder that exists, got {str(folder)!r}")
    if output.exists() and not output.is_dir():
        raise ValueError(f"output must be a folder, got the file {str(output)!r}")
    old = [p for p in output.glob("*") if WRITTEN.fullmatch(p.name) or p.name == REPORT]
    if old and not overwrite and not (large and (output / "journal").exists()):
        raise ValueError(
            f"output must have no panoramas yet, got {str(min(old))!r}: --overwrite replaces them"
        )
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in PHOTOGRAPHS and p.is_file())
    files = [p for p in files if p not in old]
    if not files:
        raise ValueError(f"folder must have images, got none in {str(folder)!r}")
    if large is not None:
        if crop:
            raise ValueError("crop must not be given with large: cut the panorama that is written")
        given = {"surface": surface, "scale": scale, "compensate": compensate, "suffix": large}
        with cvkern.use(backend=backend, device=device):
            written = _large(files, output, focal, given | {"overwrite": overwrite}, max_pixels)
        _forget({*old} - written)
        return
    with cvkern.use(backend=backend, device=device), progress_bar() as bar:
        task = bar.add_task("Reading", total=len(files))
        images, lengths, names, unreadable = [], [], [], {}
        for file in files:
            bar.advance(task)
            try:
                images.append(read_image(file))
            except (ValueError, OSError) as error:
                unreadable[file.name] = str(error).rpartition(f"{str(file)!r}: ")[2]
                continue
            names.append(file.name)
            found = focal if focal is not None else focal_length(file, images[-1].shape)
            lengths.append(math.nan if found is None else found)
        if not images:
            name, reason = next(iter(unreadable.items()))
            raise ValueError(f"folder must have images that can be read, got {name!r}: {reason}")
        dtypes = _make_alike(images)
        known = None if np.isnan(lengths).all() else lengths
        made = cvkern.stitch(
            images, surface=surface, scale=scale, crop=crop, compensate=compensate,
            focal_lengths=known, max_pixels=max_pixels, names=names,
            progress=lambda done, total, text: bar.update(
                task, completed=done, total=total, description=text
            ),
        )  # fmt: skip
    for name, reason in unreadable.items():
        typer.echo(f"{name}: left out, it cannot be read: {reason}", err=True)
    for i, dtype in dtypes.items():
        typer.echo(f"{names[i]}: {dtype} became {images[i].dtype}, as most are", err=True)
    output.mkdir(parents=True, exist_ok=True)
    written = []
    for number, one in enumerate(made, 1):
        real = one.image.dtype.kind == "f"
        written.append(output / f"panorama-{number}.{'tif' if real else 'png'}")
        write_image(written[-1], one.image)
    _report(output, names, unreadable, made, written)
    _forget({*old} - {*written, output / REPORT})


def _forget(stale: set[Path]) -> None:
    """Remove panoramas of an earlier run, those of Zarr are folders."""
    for path in stale:
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


def _large(
    files: list[Path], output: Path, focal: float | None, options: dict[str, Any], max_pixels: int
) -> set[Path]:
    """Make panoramas of photographs that need not fit into memory; return the files of results."""
    from cvkern.scale import stitch
    from cvkern.scale.panoramas import MAX_PIXELS as MOST

    lengths = "exif" if focal is None else [focal] * len(files)
    most = MOST if max_pixels == MAX_PIXELS else max_pixels
    with progress_bar() as bar:
        task = bar.add_task("Reading", total=len(files))
        found = stitch(
            files, output, focal_lengths=lengths, max_pixels=most, **options,
            progress=lambda done, total, text: bar.update(
                task, completed=done, total=total, description=text
            ),
        )  # fmt: skip
    failed = {
        Path(file).name: reason.rpartition(f"{file!r}: ")[2]
        for file, reason in found.failed.items()
    }
    for name, reason in failed.items():
        typer.echo(f"{name}: left out, it cannot be read: {reason}", err=True)
    count = len(found.panoramas)
    written = [output / f"panorama-{n + 1}{options['suffix']}" for n in range(count)]
    names = [Path(file).name for file in found.files]
    _report(output, names, failed, found.panoramas, written)
    masks = {file.with_name(f"{file.stem}-mask{file.suffix}") for file in written}
    return {*written, *masks, output / REPORT}


def _report(
    output: Path,
    names: list[str],
    unreadable: dict[str, str],
    made: list[Any],
    written: list[Path],
) -> None:
    """Write the report of the panoramas, and tell of each."""
    from cvkern._files import write_text

    for one, file in zip(made, written, strict=True):
        typer.echo(f"{file}: {len(one.members)} photographs, {_size(one)}, {one.surface}")
    together = {i for one in made for i in one.members}
    strangers = [
        name for i, name in enumerate(names) if i not in together and name not in unreadable
    ]
    report = {
        "photographs": [name for name in names if name not in unreadable],
        "pairs": [[names[i], names[j]] for one in made for i, j in one.pairs],
        "strangers": strangers,
        "unreadable": unreadable,
        "panoramas": [
            _entry(one, names, file.name) for one, file in zip(made, written, strict=True)
        ],
    }
    write_text(output / REPORT, json.dumps(report, indent=1) + "\n")
    typer.echo(f"{output / REPORT}: {len(made)} panoramas, {len(strangers)} strangers")


def _make_alike(images: list[np.ndarray]) -> dict[int, np.dtype]:
    """Convert images in place to the commonest dtype, if tied the widest; return the old dtypes.

    White stays white.
    """
    from cvkern._whites import white_of, white_of_all
    from cvkern.features._photographs import converted, dtype_of_most

    dtypes = [image.dtype for image in images]
    most = dtype_of_most(dtypes)
    others = {i: dtype for i, dtype in enumerate(dtypes) if dtype != most}
    white = white_of_all([image for image in images if image.dtype == most])
    for i in others:
        images[i] = converted(images[i], white_of(images[i]), most, white)
    return others


def _size(one: Any) -> str:
    return f"{one.image.shape[1]} x {one.image.shape[0]} pixels"


def _entry(one: Any, names: list[str], file: str) -> dict[str, Any]:
    """Return the entry of a panorama in the report; unknown numbers are null."""

    def numbers(array: np.ndarray) -> Any:
        return None if np.isnan(array).any() else array.astype(np.float64).round(9).tolist()

    return {
        "file": file,
        "width": one.image.shape[1],
        "height": one.image.shape[0],
        "members": [names[i] for i in one.members],
        "model": one.model,
        "surface": one.surface,
        "closed": one.closed,
        "focal_lengths": numbers(one.focal_lengths),
        "rotations": numbers(one.rotations),
        "matrices": numbers(one.matrices),
        "lens": round(one.lens, 9),
        "gains": numbers(one.gains),
        "residual": round(one.residual, 6),
    }
