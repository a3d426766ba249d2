"""``cvkern edges``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import cvkern
from cvkern.app.commands import Backend, Device, as_gray, write_csv

LOW = "10 % of the dtype's range; an eighth of that with gaussian"
HIGH = "20 % of the dtype's range; an eighth of that with gaussian"


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
    from cvkern.images.drawing import overlay_mask
    from cvkern.images.files import read_image, write_image

    if subpixel and (operator, norm) != ("gaussian", "l2"):
        raise ValueError(
            "subpixel must go with operator 'gaussian' and norm 'l2', "
            f"got {operator!r} and {norm!r}"
        )
    names = [file.resolve() for file in (photo, output, subpixel) if file]
    if len(set(names)) < len(names):
        raise ValueError(f"output must be a file of its own, got {str(output)!r}")
    image = read_image(photo)
    gray = as_gray(image)
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
            table = (points.points, points.orientation, points.strength)
            write_csv(beside, "row,column,orientation,strength", *table)
            write_image(output, shown)
        said += f"\n{subpixel}: {len(points.points)} sub-pixel edges"
    else:
        write_image(output, shown)
    typer.echo(said)
