"""``cvkern view``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

import cvkern
from cvkern.app.commands import Backend, Device, Overwrite, check_new
from cvkern.app.viewer.server import HOST, PORT, Page

if TYPE_CHECKING:
    from cvkern.radiance import Model

Host = Annotated[
    str, typer.Option(help="Address to listen on; 0.0.0.0 for every machine that reaches this one.")
]
Port = Annotated[int, typer.Option(help="Port of the page.")]


def view(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Photograph, model (.npz), cloud or splats (.ply), or map (.npy, .tif).",
        ),
    ],
    host: Host = HOST,
    port: Port = PORT,
    record: Annotated[
        Path | None,
        typer.Option(help="Write a recording for rerun, .rrd, and open no page."),
    ] = None,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Show a file on a page in the browser, until Ctrl-C.

    A photograph has sliders for the parameters of edges, segments and circles. A radiance field is
    rendered from where you stand, coarsely while you move. A map of depths or disparities, an image
    of floating-point numbers, tells the value where you click. Only this machine sees the page,
    unless --host says otherwise; nothing but FILE is served. Needs viser; --record needs rerun.
    """
    if not file.is_file():
        raise FileNotFoundError(f"file must be one that exists, got {str(file)!r}")
    with cvkern.use(backend=backend, device=device):
        if record is not None:
            if record.suffix != ".rrd":
                raise ValueError(f"record must end in .rrd, got {str(record)!r}")
            check_new(record, "record", overwrite)
            _record(file, record)
            typer.echo(str(record))
            return
        page, serve = _page(file, host, port)
        typer.echo(f"{page.address}: open it in a browser; Ctrl-C ends")
        page.wait(serve)


def _page(file: Path, host: str, port: int) -> tuple[Page, Callable[[], bool]]:
    """Open the page of a file; return it, and what serves it."""
    model = _model(file)
    if model is not None:
        from cvkern.app.viewer.fields import FieldPage

        field = FieldPage(model.cameras, host, port)
        return field.page, lambda: field.serve(model)
    if file.suffix == ".ply":
        from cvkern.app.viewer.clouds import cloud_page
        from cvkern.clouds.ply import read_ply

        return cloud_page(*read_ply(file), host, port), lambda: False
    from cvkern.app.viewer.photographs import PhotographPage, map_page

    values = _values(file)
    if _is_map(values):
        return map_page(values, host, port), lambda: False
    photograph = PhotographPage(values, host, port)
    return photograph.page, photograph.serve


def _model(file: Path) -> Model | None:
    """Return the radiance field of a file, or None if there is none in it."""
    if file.suffix == ".npz":
        from cvkern.radiance import load_model

        return load_model(file)
    if file.suffix == ".ply":
        from cvkern.clouds.ply import properties
        from cvkern.radiance import load_splats
        from cvkern.radiance.splats.starts import TINTS

        return load_splats(file) if set(TINTS) <= set(properties(file)) else None
    return None


def _record(file: Path, target: Path) -> None:
    """Write a recording of a file."""
    from cvkern.app.viewer.recordings import Recording

    recording = Recording(target)
    model = _model(file)
    if model is not None:
        recording.field(model)
    elif file.suffix == ".ply":
        from cvkern.clouds.ply import read_ply

        recording.cloud(*read_ply(file))
    else:
        values = _values(file)
        (recording.map if _is_map(values) else recording.photograph)(values)
    recording.save()


def _values(file: Path) -> np.ndarray:
    """Read a photograph, or a map."""
    from cvkern.images import read_image

    return np.load(file, allow_pickle=False) if file.suffix == ".npy" else read_image(file)


def _is_map(values: np.ndarray) -> bool:
    return values.dtype.kind == "f" and values.ndim == 2
