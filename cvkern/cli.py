"""The ``cvkern`` command."""

from __future__ import annotations

import platform
import sys
from importlib import metadata
from pathlib import Path
from typing import Annotated

import typer

import cvkern

app = typer.Typer(
    name="cvkern",
    help="Classical computer vision as data-parallel kernels, on the CPU and on GPUs.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

LOW = "10 % of the dtype's range; an eighth of that with gaussian"
HIGH = "20 % of the dtype's range; an eighth of that with gaussian"

Backend = Annotated[
    str | None, typer.Option(help="Kernel set: warp or taichi.", show_default="warp")
]
Device = Annotated[
    str | None, typer.Option(help="Device: cpu, cuda or cuda:N.", show_default="cpu")
]


def main() -> None:
    """Run the command; a mistake of the user is one red line and exit code 2."""
    try:
        app()
    except (ValueError, OSError, ImportError) as error:
        from rich.console import Console
        from rich.text import Text

        line = " ".join(f"error: {error}".split())
        Console(stderr=True).print(Text(line, style="red"), soft_wrap=True)
        sys.exit(2)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"cvkern {cvkern.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    pass


@app.command()
def edges(
    photo: Annotated[Path, typer.Argument(metavar="PHOTO", help="Image to read.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Image to write.")],
    sigma: Annotated[float, typer.Option(help="Standard deviation of the Gaussian, pixels.")] = 1.0,
    low_threshold: Annotated[
        float | None,
        typer.Option(help="Gradient above which an edge goes on.", show_default=LOW),
    ] = None,
    high_threshold: Annotated[
        float | None,
        typer.Option(help="Gradient above which an edge starts.", show_default=HIGH),
    ] = None,
    use_quantiles: Annotated[
        bool, typer.Option("--use-quantiles", help="Thresholds are quantiles, in [0, 1].")
    ] = False,
    operator: Annotated[
        str, typer.Option(help="Derivative: gaussian, sobel or scharr.")
    ] = "gaussian",
    norm: Annotated[str, typer.Option(help="Length of the gradient: l1 or l2.")] = "l2",
    mode: Annotated[
        str, typer.Option(help="Border: reflect, constant, nearest, mirror or wrap.")
    ] = "reflect",
    cval: Annotated[float, typer.Option(help="Value beyond a constant border.")] = 0.0,
    overlay: Annotated[
        bool, typer.Option("--overlay", help="Draw the edges over the photograph.")
    ] = False,
    subpixel: Annotated[
        Path | None,
        typer.Option(help="CSV to write sub-pixel edges to: row, column, orientation, strength."),
    ] = None,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Find the edges of a photograph (Canny).

    Thresholds are in the units of the file. Colour becomes grey, rounded to the dtype of the file.
    """
    from cvkern.images import luma, overlay_mask, read_image, write_image

    if subpixel and (operator, norm) != ("gaussian", "l2"):
        raise ValueError(
            "subpixel must go with operator 'gaussian' and norm 'l2', "
            f"got {operator!r} and {norm!r}"
        )
    names = [file.resolve() for file in (photo, output, subpixel) if file]
    if len(set(names)) < len(names):
        raise ValueError(f"output must be a file of its own, got {str(output)!r}")
    image = read_image(photo)
    gray = image if image.ndim == 2 else luma(image)
    if image.dtype.kind == "u":
        gray = gray.round().astype(image.dtype)
    with cvkern.use(backend=backend, device=device):
        thresholds = (sigma, low_threshold, high_threshold)
        mask = cvkern.canny(
            gray,
            *thresholds,
            use_quantiles=use_quantiles,
            operator=operator,
            norm=norm,
            mode=mode,
            cval=cval,
        )
        points = subpixel and cvkern.subpixel_edges(
            gray, *thresholds, use_quantiles=use_quantiles, mode=mode, cval=cval
        )
    shown = overlay_mask(image, mask) if overlay else mask
    said = f"{output}: {int(mask.sum())} edge pixels of {mask.shape[0]} x {mask.shape[1]}"
    if subpixel and points:
        from cvkern._files import replacing

        # The image is written inside, so that an error in either leaves neither.
        with replacing(subpixel) as beside:
            _write_csv(beside, points)
            write_image(output, shown)
        said += f"\n{subpixel}: {len(points.points)} sub-pixel edges"
    else:
        write_image(output, shown)
    typer.echo(said)


def _write_csv(file: Path, found: cvkern.SubpixelEdges) -> None:
    import numpy as np

    table = np.column_stack((found.points, found.orientation, found.strength))
    names = "row,column,orientation,strength"
    np.savetxt(file, table, fmt="%.9g", delimiter=",", header=names, comments="")  # 9: float32


@app.command()
def tour(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder to write to; made if missing.")
    ] = Path("cvkern-tour"),
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Run everything on sample photographs, and write pictures, timings and a page."""
    from cvkern.tour import tour as run

    with cvkern.use(backend=backend, device=device), _progress() as bar:
        task = bar.add_task("", total=None)
        page = run(
            folder,
            progress=lambda done, total, text: bar.update(
                task, completed=done, total=total, description=text
            ),
        )
    typer.echo(f"{page}: open it in a browser")


@app.command()
def warmup(backend: Backend = None, device: Device = None) -> None:
    """Compile every kernel ahead, so that first calls are fast."""
    from cvkern._warmup import calls

    todo = list(calls())
    with cvkern.use(backend=backend, device=device), _progress() as bar:
        task = bar.add_task("", total=len(todo))
        for name, call in todo:
            bar.update(task, description=name)
            call()
            bar.advance(task)
    typer.echo("All kernels are compiled.")


@app.command()
def doctor() -> None:
    """Show versions, devices and kernel caches, and test that kernels compute right answers.

    Exits with 1 if a kernel set fails on the CPU, or is wrong on a GPU that it can use.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from cvkern._doctor import CHECKS, examine, folder_size
    from cvkern._runtime import KERNEL_SETS

    console = Console()
    versions = Table.grid(padding=(0, 3))
    versions.add_row("cvkern", cvkern.__version__)
    versions.add_row("Python", f"{platform.python_version()} on {platform.platform()}")
    for label, package in (("NumPy", "numpy"), ("Warp", "warp-lang"), ("Taichi", "taichi")):
        versions.add_row(label, _version(package))
    console.print(versions, Text())
    with console.status("") as status:
        findings = []
        for device in ("cpu", "cuda"):
            for name in KERNEL_SETS:
                status.update(f"Testing {name} on {device}")
                findings.append(examine(name, device))
    health = Table("Kernels", "Device", *CHECKS, "First calls", box=None, pad_edge=False)
    notes = []
    for finding in findings:
        cells = []
        for check in CHECKS:
            wrong = finding.wrong.get(check)
            cells.append(
                Text("right", "green") if wrong == "" else
                Text("-", "dim") if wrong is None else Text("wrong", "red")
            )  # fmt: skip
        took = "" if finding.absent else f"{finding.seconds:.1f} s"
        health.add_row(finding.backend, finding.device, *cells, took)
        notes += [(finding, f"{k}: {v}", "red") for k, v in finding.wrong.items() if v]
        notes += [(finding, finding.absent, "dim")] if finding.absent else []
    console.print(health, Text())
    for finding, note, style in notes:
        console.print(Text(f"{finding.backend} on {finding.device}: {note}", style), soft_wrap=True)
    places = Table.grid(padding=(0, 3))
    for number, device in enumerate(dict.fromkeys(d for f in findings for d in f.devices)):
        places.add_row("" if number else "Devices", device)
    for name, cache in {f.backend: f.cache for f in findings if f.cache}.items():
        size = f"{folder_size(cache) / 2**20:.1f} MiB"
        places.add_row(f"Kernel cache of {name}", Text(f"{cache} ({size})", overflow="fold"))
    console.print(*([Text()] if notes else []), places)
    if not all(finding.healthy or finding.absent for finding in findings):
        raise typer.Exit(1)


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _progress():
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (BarColumn(32), MofNCompleteColumn(), TextColumn("{task.description}"))
    console = Console(stderr=True)
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


if __name__ == "__main__":
    main()
