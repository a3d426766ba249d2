"""``cvkern cameras``."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Annotated, Any

import typer

import cvkern
from cvkern.app.commands import (
    PHOTOGRAPHS,
    Backend,
    Device,
    Folder,
    OverwriteFolder,
    Seed,
    check_folder,
    progress_bar,
)

PICTURE, JOURNAL = "cameras.png", "journal"
RESULTS = (
    *(f"{name}.{kind}" for name in ("cameras", "images", "points3D") for kind in ("txt", "bin")),
    "transforms.json", "points.ply", PICTURE,
)  # fmt: skip


def cameras(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of photographs.")],
    output: Folder,
    focal: Annotated[
        float | None,
        typer.Option(help="Focal length of all, pixels.", show_default="EXIF, else found"),
    ] = None,
    lens: Annotated[
        str, typer.Option(help="shared by photographs of one size, or each its own.")
    ] = "shared",
    pairs: Annotated[
        str, typer.Option(help="Photographs to compare: auto, all, vocabulary or sequence.")
    ] = "auto",
    neighbors: Annotated[
        int, typer.Option(help="How many others each photograph is compared with, if not all.")
    ] = 16,
    models: Annotated[
        str,
        typer.Option(help="largest, or all: further models are written into DIR/model-2, ..."),
    ] = "largest",
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue a run that was stopped, if there is one.")
    ] = False,
    binary: Annotated[
        bool, typer.Option("--binary", help="Write COLMAP's files as .bin, not .txt.")
    ] = False,
    seed: Seed = 0,
    overwrite: OverwriteFolder = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Find the cameras of a folder of photographs of one scene, and points of the scene.

    DIR is made if missing. It gets the reconstruction in COLMAP's format, transforms.json for
    radiance fields, the points as points.ply, and a picture, cameras.png. Photographs that could
    not be placed are named. Photographs are taken as they are stored, whatever their EXIF
    orientation. A run that is stopped leaves DIR/journal, with which --resume goes on.
    """
    check_folder(output, RESULTS, overwrite)
    if output.resolve() == folder.resolve():
        raise ValueError(f"output must not be the folder of photographs, got {str(output)!r}")
    journal = output / JOURNAL
    if journal.exists() and not resume:
        if not overwrite:
            raise ValueError(
                f"output must have no journal of a run, got {str(journal)!r}: --resume goes on "
                "with it, --overwrite replaces it"
            )
        shutil.rmtree(journal)
    fresh = not output.exists()
    output.mkdir(parents=True, exist_ok=True)
    try:
        with cvkern.use(backend=backend, device=device), progress_bar() as bar:
            task = bar.add_task("Reading", total=None)
            found = cvkern.reconstruct(
                folder, focal_lengths=focal, lens=lens, pairs=pairs, neighbors=neighbors,
                models=models, seed=seed, journal=journal,
                progress=lambda done, total, text: bar.update(
                    task, completed=done, total=total, description=text
                ),
            )  # fmt: skip
        if not len(found.placed):
            raise ValueError(
                "folder must have photographs of one scene from several places, got "
                f"{str(folder)!r}"
            )
    except BaseException:
        if fresh and not any(output.iterdir()):
            output.rmdir()
        raise
    for n, model in enumerate((found, *found.others)):
        place = output / f"model-{n + 1}" if n else output
        place.mkdir(exist_ok=True)
        _write(place, model, folder, binary)
        error = float(model.errors.mean()) if len(model.errors) else 0.0
        typer.echo(
            f"{place}: {len(model.placed)} of {len(model.names)} photographs, "
            f"{len(model.points)} points, mean error {error:.2f} pixels"
        )
    there = {int(i) for model in (found, *found.others) for i in model.placed}
    missing = [name for i, name in enumerate(found.names) if i not in there]
    if missing:
        typer.echo(f"not placed: {', '.join(missing)}")


def _write(output: Path, found: Any, photographs: Path, binary: bool) -> None:
    """Write the files of a model, and remove those that an earlier run left."""
    from cvkern.images.files import write_image

    beside = Path(os.path.relpath(photographs.resolve(), output.resolve())).as_posix()
    written = []
    for format in ("colmap_binary" if binary else "colmap", "transforms", "ply"):
        written += cvkern.write_reconstruction(output, found, format=format, images=beside)
    write_image(output / PICTURE, found.picture())
    for name in {*RESULTS} - {file.name for file in written} - {PICTURE}:
        (output / name).unlink(missing_ok=True)


def without_cameras(path: Path) -> bool:
    """Tell whether a folder has photographs, and no file with their cameras."""
    named = ("transforms*.json", "poses_bounds.npy", "cameras.*", "sparse")
    if not path.is_dir() or any(any(path.glob(name)) for name in named):
        return False
    return any(file.suffix.lower() in PHOTOGRAPHS for file in path.iterdir())


def reconstructed(path: Path, test_every: int) -> Any:
    """Find the cameras of a folder of photographs, and return these as a scene."""
    from cvkern.radiance.scenes.photographs import read_images

    with progress_bar() as bar:
        task = bar.add_task("Reading", total=None)
        found = cvkern.reconstruct(
            path,
            progress=lambda done, total, text: bar.update(
                task, completed=done, total=total, description=text
            ),
        )
    if not len(found.placed):
        raise ValueError(
            f"scene must be photographs of one scene from several places, got {str(path)!r}"
        )
    if found.unplaced:
        typer.echo(f"not placed: {', '.join(found.unplaced)}")
    images = read_images([path / name for name in found.names])
    return found.scene(images, test_every=test_every)
