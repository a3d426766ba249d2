"""``cvkern view``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

import cvkern
from cvkern._archives import map_array
from cvkern.app.commands import Backend, Device, Overwrite, check_new
from cvkern.app.viewer.server import HOST, PORT, Page

if TYPE_CHECKING:
    from cvkern.radiance import Model

Camera = tuple[float, float, float]
"""Focal length, baseline and difference of principal points."""

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
    focal: Annotated[
        float | None, typer.Option(help="Focal length in pixels; the map holds disparities.")
    ] = None,
    baseline: Annotated[
        float | None, typer.Option(help="Distance between the cameras; depth has its unit.")
    ] = None,
    doffs: Annotated[
        float, typer.Option(help="Right principal point minus the left one, pixels.")
    ] = 0.0,
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
    of floating-point numbers, tells the value where you click; with --focal and --baseline, the
    depth of a disparity too. Only this machine sees the page, unless --host says otherwise; nothing
    but FILE is served. Needs viser; --record needs rerun.
    """
    if not file.is_file():
        raise FileNotFoundError(f"file must be one that exists, got {str(file)!r}")
    if (focal is None) != (baseline is None):
        raise ValueError(f"focal must be given with baseline, got {focal} and {baseline}")
    camera = None if focal is None or baseline is None else (focal, baseline, doffs)
    values = None if file.suffix in (".npz", ".ply") else _values(file)
    if camera is not None and (values is None or not _is_map(values)):
        raise ValueError(f"focal must go with a map of disparities, got {str(file)!r}")
    with cvkern.use(backend=backend, device=device):
        if record is not None:
            if record.suffix != ".rrd":
                raise ValueError(f"record must end in .rrd, got {str(record)!r}")
            check_new(record, "record", overwrite)
            _record(file, values, record, camera)
            typer.echo(str(record))
            return
        page, serve = _page(file, values, host, port, camera)
        typer.echo(f"{page.address}: open it in a browser; Ctrl-C ends")
        page.wait(serve)


def _page(
    file: Path, values: np.ndarray | None, host: str, port: int, camera: Camera | None
) -> tuple[Page, Callable[[], bool]]:
    """Open the page of a file, or of its values; return it, and the function that serves it."""
    model = _model(file)
    if model is not None:
        from cvkern.app.viewer.fields import FieldPage

        field = FieldPage(model.cameras, host, port)
        return field.page, lambda: field.serve(model)
    if values is None:
        from cvkern.app.viewer.clouds import cloud_page
        from cvkern.clouds.ply import read_ply

        return cloud_page(*read_ply(file), host, port), lambda: False
    from cvkern.app.viewer.photographs import PhotographPage, map_page

    if _is_map(values):
        depth = None if camera is None else cvkern.disparity_to_depth(values, *camera)
        return map_page(values, host, port, depth), lambda: False
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


def _record(file: Path, values: np.ndarray | None, target: Path, camera: Camera | None) -> None:
    """Write a recording of a file, or of its values; of disparities with a camera, their depth."""
    from cvkern.app.viewer.recordings import Recording

    recording = Recording(target)
    model = _model(file)
    if model is not None:
        recording.field(model)
    elif values is None:
        from cvkern.clouds.ply import read_ply

        recording.cloud(*read_ply(file))
    else:
        shown = values if camera is None else cvkern.disparity_to_depth(values, *camera)
        (recording.map if _is_map(shown) else recording.photograph)(shown)
    recording.save()


def _values(file: Path) -> np.ndarray:
    """Read a photograph, or a map."""
    from cvkern.images import read_image

    return map_array(file, "file") if file.suffix == ".npy" else read_image(file)


def _is_map(values: np.ndarray) -> bool:
    return values.dtype.kind == "f" and values.ndim == 2
