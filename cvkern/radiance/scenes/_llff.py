"""Scenes of LLFF: ``poses_bounds.npy`` and a folder of photographs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cvkern.radiance.pinhole import cameras
from cvkern.radiance.scenes._masks import beside, read_masks
from cvkern.radiance.scenes.photographs import Bounds, Scene, every, focus_of, read_images, shrunk

FOLDERS = ("images", "images_2", "images_4", "images_8")
KINDS = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
MARGIN = 0.9  # start of rays, as a share of the distance of the nearest point


def load(file: Path, test_every: int) -> Scene:
    """Read a scene; see :func:`cvkern.radiance.load_scene`."""
    try:
        with file.open("rb") as stream:
            table = np.lib.format.read_array(stream, allow_pickle=False).astype(np.float64)
    except ValueError as error:
        raise ValueError(f"{file} must be an array of NumPy: {error}") from None
    if table.ndim != 2 or table.shape[1] != 17 or not np.isfinite(table).all():
        raise ValueError(f"{file} must be finite, of shape (N, 17), got {table.shape}")
    files = photographs(file, len(table))
    images = read_images(files)
    height, width = images.shape[1:3]
    masks = read_masks(beside(files[0].parent, [f.name for f in files]), height, width)
    blocks = table[:, :15].reshape(-1, 3, 5)
    if not (blocks[:, :, 4] > 0).all():
        raise ValueError(f"{file} must give heights, widths and focal lengths > 0")
    # The columns are down, right, backward, the centre, and height, width, focal length.
    down, right, back, eye = (blocks[:, :, i] for i in range(4))
    poses = np.stack((right, down, -back, eye), axis=2)
    lenses = blocks[:, :, 4]
    focal = np.array([f * shrunk(width, height, w, h, file)[0] for h, w, f in lenses])
    middle = [0.5 * (width - 1), 0.5 * (height - 1)]
    intrinsics = np.column_stack((focal, focal, np.broadcast_to(middle, (len(table), 2))))
    try:
        views = cameras(poses, intrinsics, width, height)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    near, far = MARGIN * table[:, 15].min(), table[:, 16].max()
    if not 0 < near < far:
        raise ValueError(f"{file} must give bounds with 0 < near < far, got {near:g} and {far:g}")
    corner = np.hypot(width, height) / (2 * focal.min())
    far *= np.hypot(1, corner)  # bounds are along the axis; rays to the corners are longer
    center = focus_of(poses)
    half = float(np.abs(poses[:, :, 3] - center).max() + 0.5 * near)
    held = every(len(images), test_every)
    bounds = Bounds((float(center[0]), float(center[1]), float(center[2])), half, True)
    return Scene(images, views, held, bounds, float(near), float(far), masks=masks)


def photographs(file: Path, count: int) -> list[Path]:
    """Return the `count` photographs beside `file`, in the order of their names."""
    for name in FOLDERS:
        folder = file.parent / name
        if folder.is_dir():
            found = sorted(f for f in folder.iterdir() if f.suffix.lower() in KINDS)
            if len(found) != count:
                raise ValueError(f"{folder} must have {count} photographs, got {len(found)}")
            return found
    raise FileNotFoundError(f"scene must have a folder {FOLDERS[0]!r} beside {file}")
