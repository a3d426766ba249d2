"""``cvkern stereo``."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

import cvkern
from cvkern.app.commands import Backend, Device, Folder, OverwriteFolder, as_gray, check_folder

if TYPE_CHECKING:
    from cvkern.stereo.matching import StereoResult

Writers = dict[
    str, tuple[Callable[[Path], None], str]
]  # writers by the name of the file, each with a description of the contents

LARGEST = 256  # smallest disparity that 16 bits in units of 1/256 pixel cannot hold
CENTRE = "the middle of the image"
RESULTS = ("disparity.png", "disparity-x256.png", "disparity.tif", "depth.tif", "cloud.ply",
           "turntable.gif", "turntable.mp4")  # fmt: skip


def stereo(
    left: Annotated[Path, typer.Argument(metavar="LEFT", help="Left image.")],
    right: Annotated[Path, typer.Argument(metavar="RIGHT", help="Right image.")],
    output: Folder,
    method: Annotated[str, typer.Option(help="semi-global or window.")] = "semi-global",
    min_disparity: Annotated[int, typer.Option(help="Smallest disparity, pixels.")] = 0,
    max_disparity: Annotated[int, typer.Option(help="End of the disparities, pixels.")] = 64,
    paths: Annotated[int, typer.Option(help="Paths of semi-global: 4, 8 or 16.")] = 8,
    focal: Annotated[float | None, typer.Option(help="Focal length, pixels.")] = None,
    baseline: Annotated[
        float | None, typer.Option(help="Distance between the cameras; depth has its unit.")
    ] = None,
    doffs: Annotated[
        float, typer.Option(help="Right principal point minus the left one, pixels.")
    ] = 0.0,
    cx: Annotated[
        float | None, typer.Option(help="Column of the principal point.", show_default=CENTRE)
    ] = None,
    cy: Annotated[
        float | None, typer.Option(help="Row of the principal point.", show_default=CENTRE)
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Calibration of both cameras, for raw images."),
    ] = None,
    overwrite: OverwriteFolder = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Match a pair, and write disparity, depth, point cloud and a turn-table.

    DIR is created if missing. disparity.png shows every pixel in colour; bright means near.
    disparity-x256.png holds 256 times the disparity in 16 bits, and 0 where there is none; if 16
    bits are not enough, disparity.tif holds 32-bit floats instead. With a focal length and a
    baseline, the command also writes depth.tif (32-bit floats), cloud.ply and turntable.gif (and
    turntable.mp4 if imageio-ffmpeg is installed). Only disparity.png shows pixels that were filled
    in.

    The images are a rectified pair. With --calibration, a file of cvkern calibrate or of OpenCV,
    they are as the cameras took them, and depth is written as well.
    """
    from cvkern.images.files import read_image

    if (focal is None) != (baseline is None):
        raise ValueError(f"focal must be given with baseline, got {focal} and {baseline}")
    if focal is None and (doffs, cx, cy) != (0.0, None, None):
        raise ValueError("doffs, cx and cy must go with focal and baseline, got neither of those")
    rectify = None if calibration is None else _rectification(calibration)
    if rectify is not None:
        if (focal, doffs, cx, cy) != (None, 0.0, None, None):
            raise ValueError(
                "calibration must go without focal, baseline, doffs, cx and cy, got one of these"
            )
        focal, baseline = rectify.focal, rectify.baseline
        cx, cy = rectify.matrix[:2, 2].tolist()
    camera = None if focal is None or baseline is None else (focal, baseline)
    if camera:
        cvkern.reprojection_matrix(*camera, cx or 0.0, cy or 0.0, doffs)  # checks the numbers
    check_folder(output, RESULTS, overwrite)
    views = [read_image(file) for file in (left, right)]
    if rectify is not None:
        with cvkern.use(backend=backend, device=device):
            views = list(rectify(*views))
    color = all(view.ndim == 3 for view in views)
    one, other = (view[..., :3] if color else as_gray(view) for view in views)
    with cvkern.use(backend=backend, device=device):
        found = cvkern.stereo_match(
            one,
            other,
            (min_disparity, max_disparity),
            method=method,
            paths=paths,
            channel_axis=-1 if color else None,
        )
        files = _disparity(found, min_disparity >= 0 and max_disparity <= LARGEST)
        if camera:
            height, width = found.valid.shape
            column = 0.5 * (width - 1) if cx is None else cx
            row = 0.5 * (height - 1) if cy is None else cy
            q = cvkern.reprojection_matrix(*camera, column, row, doffs)
            depth = cvkern.disparity_to_depth(found.disparity, *camera, doffs)
            files |= _space(found, views[0], depth, q)
    output.mkdir(parents=True, exist_ok=True)
    for name, (write, said) in files.items():
        write(output / name)
        typer.echo(f"{output / name}: {said}")
    if not camera:
        typer.echo("no depth: that needs --focal and --baseline, or --calibration")


def _rectification(file: Path) -> cvkern.Rectification:
    """Return how the cameras of a file are rectified, without empty pixels."""
    found = cvkern.read_calibration(file)
    if not isinstance(found, cvkern.StereoCalibration):
        raise ValueError(f"calibration must be of two cameras, got one in {str(file)!r}")
    return cvkern.rectify_stereo(found, keep="valid")


def _disparity(found: StereoResult, fits: bool) -> Writers:
    """Return the writers of the disparities; `fits` says whether 16 bits hold them."""
    from cvkern.images.colors import apply_colormap
    from cvkern.images.files import write_image

    valid, shape = found.valid, " x ".join(map(str, found.valid.shape))
    shown = apply_colormap(found.disparity)
    share = f"{valid.mean():.1%} of {shape} pixels matched, the others filled in"
    files: Writers = {"disparity.png": (lambda path: write_image(path, shown), share)}
    if fits:
        # A match at disparity 0 is stored as 1, because 0 means that there is none.
        steps = np.where(valid, np.maximum(np.round(256 * found.disparity), 1), 0)
        name, values, said = (
            "disparity-x256.png",
            steps.astype(np.uint16),
            "1/256 pixel, 0 for none",
        )
    else:
        exact = np.where(valid, found.disparity, np.float32(np.nan))
        name, values, said = "disparity.tif", exact, "pixels, NaN for none"
    files[name] = lambda path: write_image(path, values), said
    return files


def _space(found: StereoResult, left: np.ndarray, depth: np.ndarray, q: np.ndarray) -> Writers:
    """Return the writers of depth and points; refuse a result without points before the camera."""
    from cvkern.clouds import turntable, write_animation, write_ply
    from cvkern.images._overlay import canvas
    from cvkern.images.files import write_image

    known = found.valid & np.isfinite(depth)
    if not known.any():
        raise ValueError("no pixel has a depth: the images do not match in these disparities")
    cloud = cvkern.point_cloud(found.disparity, q, canvas(left), known)
    movie = turntable(*cloud)
    show = (lambda path: write_animation(path, movie)), f"{len(movie)} frames"
    near, far = depth[known].min(), depth[known].max()
    exact = np.where(known, depth, np.float32(np.nan))
    files: Writers = {
        "depth.tif": (lambda path: write_image(path, exact), f"{near:.6g} to {far:.6g}"),
        "cloud.ply": (lambda path: write_ply(path, *cloud), f"{len(cloud.points)} points"),
        "turntable.gif": show,
    }
    if importlib.util.find_spec("imageio_ffmpeg"):
        files["turntable.mp4"] = show
    return files
