"""``cvkern scale``."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Annotated, Any

import typer

import cvkern
from cvkern.app.commands import Backend, Device, Overwrite, check_apart, check_new, progress_bar


def scale(
    function: Annotated[
        str, typer.Argument(metavar="FUNCTION", help="Function of cvkern: gaussian, canny, ...")
    ],
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", help="Array, image, or folder of photographs.")
    ],
    target: Annotated[
        Path, typer.Argument(metavar="TARGET", help="Array, image or folder to write.")
    ],
    options: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME=VALUE]...", help="Options of the function.")
    ] = None,
    tile: Annotated[
        int | None, typer.Option(help="Height and width of a tile, pixels.", show_default="by file")
    ] = None,
    suffix: Annotated[str, typer.Option(help="Form of the results of a folder.")] = ".npy",
    engine: Annotated[
        str, typer.Option(help="For a folder: threads, processes, dask or ray.")
    ] = "threads",
    workers: Annotated[
        int, typer.Option(help="Threads, processes, workers or actors for a folder.")
    ] = 2,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Apply a function to an image larger than memory, or to every photograph of a folder.

    SOURCE is an array of NumPy (.npy), a TIFF or an array of Zarr (.zarr), read tile by tile; or
    any photograph. TARGET is a .npy, .tif or .zarr, written tile by tile. A function with several
    results writes one file for each, as gradient writes out.dy.npy. If a run is killed, the same
    command goes on with what is left. Options are those of the Python function: sigma=2,
    mode=nearest.
    """
    given = dict(_option(word) for word in options or ())
    if source.is_dir() and source.suffix != ".zarr":
        _folder(
            function, source, target, given, suffix, engine, workers, overwrite, device, backend
        )
        return
    try:
        files = _image(function, source, target, given, tile, overwrite, backend, device)
    except TypeError as error:  # the function refuses an option
        raise ValueError(str(error)) from None
    typer.echo(", ".join(str(file) for file in files))


def _image(
    function: str,
    source: Path,
    target: Path,
    options: dict[str, Any],
    tile: int | None,
    overwrite: bool,
    backend: str | None,
    device: str | None,
) -> list[Path]:
    """Write the results of one image; return their files."""
    from cvkern.scale import apply, halo
    from cvkern.scale.engines import with_channels
    from cvkern.scale.sources import opened
    from cvkern.scale.targets import target_of
    from cvkern.scale.tiles import results_of

    check_apart((source,), target=target)
    journal = target.with_name(target.name + ".journal")
    image = opened(source)
    options = with_channels(getattr(cvkern, function, None), image.shape, options)
    with cvkern.use(backend=backend, device=device):
        halo(function, **options)  # refuses what does not work tile by tile
        names, shapes, dtypes = results_of(function, image, **options)
        ends = [f".{name}{target.suffix}" if name else target.suffix for name in names]
        files = [target.with_suffix(end) for end in ends]
        resumed = journal.exists() and all(file.exists() for file in files)
        if not resumed:
            for file in files:
                check_new(file, "target", overwrite)
        arrays = [
            target_of(file, shape, dtype, resumed)
            for file, shape, dtype in zip(files, shapes, dtypes, strict=True)
        ]
        with progress_bar() as bar:
            task = bar.add_task(function, total=None)
            apply(
                function,
                image,
                arrays if len(arrays) > 1 else arrays[0],
                tile=tile,
                journal=journal,
                progress=lambda done, total: bar.update(task, completed=done, total=total),
                **options,
            )
    return files


def _folder(
    function: str,
    source: Path,
    target: Path,
    options: dict[str, Any],
    suffix: str,
    engine: str,
    workers: int,
    overwrite: bool,
    device: str | None,
    backend: str | None,
) -> None:
    from cvkern.scale import map_images

    with cvkern.use(backend=backend), progress_bar() as bar:
        task = bar.add_task(function, total=None)
        report = map_images(
            source,
            function,
            target,
            suffix=suffix,
            engine=engine,
            workers=workers,
            device=device,
            overwrite=overwrite,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
            **options,
        )
    for file, reason in report.failed.items():
        typer.echo(f"{file}: {reason}", err=True)
    kept = f", {len(report.kept)} kept" if report.kept else ""
    typer.echo(f"{target}: {len(report.done)} written{kept}, {len(report.failed)} failed")
    if report.failed:
        raise typer.Exit(1)


def _option(word: str) -> tuple[str, Any]:
    """Return the name and value of ``name=value``: a Python literal, else a string."""
    name, equals, value = word.partition("=")
    if not equals or not name.isidentifier():
        raise ValueError(f"options must be of the form name=value, got {word!r}")
    try:
        return name, ast.literal_eval(value)
    except (ValueError, SyntaxError):
        return name, value
