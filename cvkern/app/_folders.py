"""Folders in place of photographs, for the commands that read one and write others."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

from cvkern.app.commands import PHOTOGRAPHS, progress_bar

# The parameters that are files to write, and their endings if a folder is read.
WRITTEN = {"output": ".png", "subpixel": ".csv", "to_csv": ".csv", "to_json": ".json"}


def over_folders(
    command: Callable[..., None], photo: str = "photo", endings: Collection[str] = PHOTOGRAPHS
) -> Callable[..., None]:
    """Let the parameter `photo` of a command be a folder: then all that it writes are folders too.

    The command runs for every file with one of these endings. A file that fails is named, and the
    others go on.
    """

    @functools.wraps(command)
    def run(**given: Any) -> None:
        import typer

        source = given[photo]
        if not source.is_dir():
            command(**given)
            return
        files = sorted(f for f in source.iterdir() if f.suffix.lower() in endings)
        targets = {name: given[name] for name in WRITTEN if given.get(name) is not None}
        _check(source, files, targets, photo)
        failed = 0
        with progress_bar() as bar:
            for file in bar.track(files, description=source.name):
                named = {
                    name: folder / f"{file.stem}{WRITTEN[name]}" for name, folder in targets.items()
                }
                try:
                    command(**given | named | {photo: file})
                except (ValueError, TypeError, OSError) as error:
                    failed += 1
                    typer.echo(f"{file}: {error}", err=True)
        typer.echo(f"{given['output']}: {len(files) - failed} written, {failed} failed")
        if failed:
            raise typer.Exit(1)

    return run


def _check(source: Path, files: list[Path], targets: dict[str, Path], photo: str) -> None:
    """Refuse folders that do not fit, and make those to write."""
    if not files:
        raise ValueError(f"{photo} must be a folder with photographs, got none in {str(source)!r}")
    stems = sorted(file.stem for file in files)
    twice = next((one for one, other in itertools.pairwise(stems) if one == other), None)
    if twice is not None:
        raise ValueError(f"{photo} must have files of different names, got {twice!r} twice")
    for name, folder in targets.items():
        if folder.resolve() == source.resolve() or (folder.exists() and not folder.is_dir()):
            raise ValueError(f"{name} must be a folder of its own, got {str(folder)!r}")
        folder.mkdir(parents=True, exist_ok=True)
