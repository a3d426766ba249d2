"""``cvkern pair``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

import cvkern
from cvkern.app.commands import Backend, Device, Folder, OverwriteFolder, check_folder

if TYPE_CHECKING:
    from cvkern.stereo.reconstruction import PairReconstruction

RESULTS = ("rectified.png", "sparse.png", "disparity.png", "depth.tif", "cloud.ply",
           "turntable.gif", "pair.json")  # fmt: skip
ROWS = 12  # lines along rows, over the rectified photographs
COLOR = (255, 98, 41)
RADIUS = 2.5


def pair(
    one: Annotated[Path, typer.Argument(metavar="A", help="Photograph.")],
    other: Annotated[Path, typer.Argument(metavar="B", help="The same scene from beside.")],
    output: Folder,
    focal: Annotated[
        float | None,
        typer.Option(help="Focal length of both, pixels.", show_default="EXIF, or a guess"),
    ] = None,
    baseline: Annotated[
        float, typer.Option(help="Distance of the cameras; gives the depth its unit.")
    ] = 1.0,
    max_keypoints: Annotated[int, typer.Option(help="Keypoints of each photograph.")] = 4000,
    max_side: Annotated[int, typer.Option(help="Longest side that is worked on, pixels.")] = 1600,
    overwrite: OverwriteFolder = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Make depth and a point cloud of two photographs of a scene, taken side by side.

    DIR is made if missing. rectified.png has both photographs with their rows level; sparse.png
    the matches that the geometry is from, coloured as disparity.png, which has every pixel, bright
    where near; depth.tif (32-bit floats), cloud.ply and turntable.gif are in space; pair.json has
    the camera matrices, the pose of the second camera and both homographies.
    """
    from cvkern.images.files import read_image

    check_folder(output, RESULTS, overwrite)
    camera = None
    if focal is not None:
        if not focal > 0:
            raise ValueError(f"focal must be > 0, got {focal:g}")
        sizes = [read_image(file).shape for file in (one, other)]
        camera = np.array(
            [[[focal, 0, (w - 1) / 2], [0, focal, (h - 1) / 2], [0, 0, 1]] for h, w, *_ in sizes]
        )
    with cvkern.use(backend=backend, device=device):
        found = cvkern.reconstruct_pair(
            one, other, camera, baseline, max_keypoints=max_keypoints, max_side=max_side
        )
    if not found.valid.any():
        raise ValueError("A and B must have pixels that match, got none")
    files = _writers(found)
    output.mkdir(parents=True, exist_ok=True)
    for name, (write, said) in files.items():
        write(output / name)
        typer.echo(f"{output / name}: {said}")


def _writers(found: PairReconstruction) -> dict[str, tuple[Callable[[Path], object], str]]:
    """Return the writer and the content of each file, by its name."""
    from cvkern._files import write_text
    from cvkern.clouds import turntable, write_animation, write_ply
    from cvkern.images.files import write_image

    level, sparse, dense = pictures(found)
    movie = turntable(*found.cloud)
    near, far = np.nanmin(found.depth), np.nanmax(found.depth)
    names = ("K", "rotation", "translation", "H0", "H1")
    facts = {name: getattr(found, name).tolist() for name in names}
    text = json.dumps(facts, indent=1) + "\n"
    share = f"{found.valid.mean():.1%} of {' x '.join(map(str, found.valid.shape))} pixels"
    return {
        "rectified.png": (lambda path: write_image(path, level), "both photographs, rows level"),
        "sparse.png": (lambda path: write_image(path, sparse), f"{len(found.points)} matches"),
        "disparity.png": (lambda path: write_image(path, dense), share),
        "depth.tif": (lambda path: write_image(path, found.depth), f"{near:.6g} to {far:.6g}"),
        "cloud.ply": (
            lambda path: write_ply(path, *found.cloud),
            f"{len(found.cloud.points)} points",
        ),
        "turntable.gif": (lambda path: write_animation(path, movie), f"{len(movie)} frames"),
        "pair.json": (lambda path: write_text(path, text), "cameras, pose, homographies"),
    }


def pictures(found: PairReconstruction) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return both photographs with level lines, the sparse points and all pixels by nearness."""
    from cvkern.images.colors import apply_colormap
    from cvkern.images.drawing import draw_lines, draw_points

    height, width = found.valid.shape
    both = np.hstack((found.image0, found.image1))
    rows = (np.arange(ROWS) + 0.5) * height / ROWS
    ends = np.stack((rows, 0 * rows, rows, 0 * rows + 2 * width - 1), 1)
    level = draw_lines(both, ends, color=COLOR, width=1.0)
    nearness = np.where(found.valid, 1 / found.depth, np.nan)
    low, high = np.nanquantile(nearness, (0.01, 0.99))
    low, high = float(low), max(float(high), float(low) + 1e-6)
    dense = apply_colormap(nearness, vmin=low, vmax=high, nan=(0, 0, 0))
    front = found.points[:, 2] > 0
    shown = apply_colormap(1 / found.points[front, 2][None], vmin=low, vmax=high)[0]
    gray = found.image0 // 2
    sparse = draw_points(gray, found.places[front], color=shown.astype(float), radius=RADIUS)
    return level, sparse, dense
