"""``cvkern edges``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import cvkern
from cvkern.app.commands import (
    Backend,
    Device,
    Drawing,
    Overwrite,
    Photo,
    check_apart,
    check_new,
    write_csv,
)

SIGMA = 1.5
LOW, HIGH = "quantile 0.7 of the image's", "quantile 0.9 of the image's"


def edges(
    photo: Photo,
    output: Drawing,
    sigma: Annotated[
        float, typer.Option(help="Standard deviation of the Gaussian, pixels.")
    ] = SIGMA,
    low_threshold: Annotated[
        float | None,
        typer.Option(help="Gradient above which an edge continues.", show_default=LOW),
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
    suppression: Annotated[
        str, typer.Option(help="How maxima are found: interpolated, or sectors as in OpenCV.")
    ] = "interpolated",
    norm: Annotated[str, typer.Option(help="Length of the gradient: l1 or l2.")] = "l2",
    mode: Annotated[
        str, typer.Option(help="Border: reflect, constant, nearest, mirror or wrap.")
    ] = "reflect",
    cval: Annotated[float, typer.Option(help="Value outside a constant border.")] = 0.0,
    overlay: Annotated[
        bool, typer.Option("--overlay", help="Draw the edges over the photograph.")
    ] = False,
    subpixel: Annotated[
        Path | None,
        typer.Option(help="CSV to write sub-pixel edges to: row, column, orientation, strength."),
    ] = None,
    overwrite: Overwrite = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Find the edges of a photograph (Canny).

    Thresholds apply to Sobel's gradient, in the units of the file. By default they are taken from
    the image. In a colour photograph, a pixel has the gradient of the channel where it is longest.
    """
    from cvkern.edges.quantiles import from_data
    from cvkern.images.drawing import overlay_mask
    from cvkern.images.files import read_image, write_image

    if subpixel and (operator, norm, suppression) != ("gaussian", "l2", "interpolated"):
        raise ValueError(
            "subpixel must go with operator 'gaussian', norm 'l2' and suppression 'interpolated', "
            f"got {operator!r}, {norm!r} and {suppression!r}"
        )
    check_apart((photo,), output=output, subpixel=subpixel)
    check_new(subpixel, "subpixel", overwrite)
    image = read_image(photo)
    with cvkern.use(backend=backend, device=device):
        low, high, use_quantiles = from_data(low_threshold, high_threshold, use_quantiles)
        thresholds = (sigma, low, high)
        mask = cvkern.canny(
            image,
            *thresholds,
            use_quantiles=use_quantiles,
            operator=operator,
            suppression=suppression,
            norm=norm,
            mode=mode,
            cval=cval,
        )
        points = subpixel and cvkern.subpixel_edges(
            image, *thresholds, use_quantiles=use_quantiles, mode=mode, cval=cval
        )
    shown = overlay_mask(image, mask) if overlay else mask
    said = f"{output}: {int(mask.sum())} edge pixels of {mask.shape[0]} x {mask.shape[1]}"
    if subpixel and points:
        from cvkern._files import replacing

        # Write the image inside, so that an error in one file leaves neither.
        with replacing(subpixel) as beside:
            table = (points.points, points.orientation, points.strength)
            write_csv(beside, "row,column,orientation,strength", *table)
            write_image(output, shown)
        said += f"\n{subpixel}: {len(points.points)} sub-pixel edges"
    else:
        write_image(output, shown)
    typer.echo(said)
