"""The ``cvkern`` command."""

from __future__ import annotations

import platform
import sys
import warnings
from importlib import metadata
from pathlib import Path
from typing import Annotated

import typer

import cvkern
from cvkern.app._folders import over_folders
from cvkern.app.commands import PHOTOGRAPHS, Backend, Device, progress_bar
from cvkern.app.commands.calibrate import calibrate
from cvkern.app.commands.cameras import cameras
from cvkern.app.commands.circles import circles
from cvkern.app.commands.develop import SUFFIXES, develop
from cvkern.app.commands.edges import edges
from cvkern.app.commands.find import find
from cvkern.app.commands.hdr import hdr
from cvkern.app.commands.lines import lines
from cvkern.app.commands.match import match
from cvkern.app.commands.nerf import nerf
from cvkern.app.commands.pair import pair
from cvkern.app.commands.panorama import panorama
from cvkern.app.commands.recognize import recognize
from cvkern.app.commands.relief import relief
from cvkern.app.commands.scale import scale
from cvkern.app.commands.scan import scan
from cvkern.app.commands.stereo import stereo
from cvkern.app.commands.view import view

app = typer.Typer(
    name="cvkern",
    help="Classical computer vision as data-parallel kernels, on the CPU and on GPUs.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Run the command; report an error of the user in one red line, with exit code 2."""
    warnings.showwarning = _show_warning
    try:
        app()
    except (ValueError, OSError, ImportError) as error:
        from rich.console import Console
        from rich.text import Text

        line = " ".join(f"error: {error}".split())
        Console(stderr=True).print(Text(line, style="red"), soft_wrap=True)
        sys.exit(2)


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    """Print a warning as one line, without its place in the program."""
    from rich.console import Console
    from rich.text import Text

    line = " ".join(f"warning: {message}".split())
    Console(stderr=True).print(Text(line, style="yellow"), soft_wrap=True)


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


app.command()(over_folders(edges))
app.command()(over_folders(lines))
app.command()(over_folders(circles))
app.command()(over_folders(find, "scene"))
app.command()(match)
app.command()(pair)
app.command()(panorama)
app.command()(calibrate)
app.command()(cameras)
app.command()(stereo)
app.command()(relief)
app.command()(scan)
app.command()(over_folders(develop, endings=(*PHOTOGRAPHS, *SUFFIXES)))
app.command()(hdr)
app.command()(scale)
app.command()(view)
app.add_typer(recognize, name="recognize")
app.add_typer(nerf, name="nerf")


@app.command()
def tour(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder to write to; made if missing.")
    ] = Path("cvkern-tour"),
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace an existing tour in DIR.")
    ] = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Run everything on sample photographs, and write pictures, timings and a page."""
    from cvkern.app.tour import tour as run

    if not overwrite and (folder / "index.html").exists():
        raise ValueError(
            f"folder must have no tour yet, got {str(folder / 'index.html')!r}: "
            "--overwrite replaces it"
        )
    with cvkern.use(backend=backend, device=device), progress_bar() as bar:
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
    """Compile every kernel in advance, so that first calls are fast."""
    from cvkern.app.warmup import compile_all

    with cvkern.use(backend=backend, device=device), progress_bar() as bar:
        task = bar.add_task("", total=None)
        for done, total, name in compile_all():
            bar.update(task, completed=done, total=total, description=name)
    typer.echo("All kernels are compiled.")


@app.command()
def doctor() -> None:
    """Show versions, devices and kernel caches, and test that kernels give correct results.

    Exit with 1 if a kernel set fails on the CPU, or is wrong on a GPU that it can use.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from cvkern._runtime import KERNEL_SETS
    from cvkern.app.doctor import CHECKS, examine, folder_size
    from cvkern.kernels._cache import VARIABLES

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
        notes += [(finding, finding.cache_fault, "yellow")] if finding.cache_fault else []
    console.print(health, Text())
    for finding, note, style in notes:
        console.print(Text(f"{finding.backend} on {finding.device}: {note}", style), soft_wrap=True)
    places = Table.grid(padding=(0, 3))
    for number, device in enumerate(dict.fromkeys(d for f in findings for d in f.devices)):
        places.add_row("" if number else "Devices", device)
    for name, cache in {f.backend: f.cache for f in findings if f.cache}.items():
        size = f"{folder_size(cache) / 2**20:.1f} MiB"
        where = f"{cache} ({size}, chosen by {VARIABLES[name]})"
        places.add_row(f"Kernel cache of {name}", Text(where, overflow="fold"))
    console.print(*([Text()] if notes else []), places)
    if not all(finding.healthy or finding.absent for finding in findings):
        raise typer.Exit(1)


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


if __name__ == "__main__":
    main()
