"""Views of a camera that turns, recognised, aligned and put together."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.ndimage as ndi

import cvkern
from profiling.case import TOY, Case, Peer, Shape, Work

STEP = 20.0  # degrees between views
FOCAL = 1.2  # widths of a view
LIMIT = 0.2  # degrees that an angle may be off; views of toy size have 128 pixels
FAILED = 180.0

Arrays = tuple[np.ndarray, ...]


def _inputs(shape: Shape, rng: np.random.Generator) -> Arrays:
    """Return views of a cylinder of blobs of all sizes, and their rotations (N, 3, 3)."""
    count, (height, width) = 3 if shape == TOY else 6, shape
    focal = FOCAL * width
    around, tall = round(2 * np.pi * focal), round(1.6 * height)
    texture = np.zeros((tall, around))
    for sigma in (1.2, 3.0, 8.0):
        layer = np.asarray(ndi.gaussian_filter(rng.normal(size=texture.shape), sigma, mode="wrap"))
        texture += layer / layer.std()
    texture = np.clip(128 + 35 * texture, 0, 255)
    y, x = np.mgrid[:height, :width].astype(float)
    rays = np.stack(((x - (width - 1) / 2) / focal, (y - (height - 1) / 2) / focal, 1 + 0 * x))
    views, rotations = [], []
    for k in range(count):
        a, b = np.radians((STEP * k, rng.normal(0, 1)))
        yaw = np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
        pitch = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
        rotations.append(pitch @ yaw)
        world = np.einsum("ji,jhw->ihw", rotations[-1], rays)
        rows = world[1] / np.hypot(world[0], world[2]) * focal + (tall - 1) / 2
        columns = np.arctan2(world[0], world[2]) * focal % around
        seen = ndi.map_coordinates(texture, np.stack((rows, columns)), order=1, mode="grid-wrap")
        views.append(np.asarray(seen).astype(np.uint8))
    return (*views, np.stack(rotations))


def _angles(rotations: np.ndarray) -> Arrays:
    """Return the angles between consecutive views, degrees."""
    across = rotations[1:] @ np.swapaxes(rotations[:-1], 1, 2)
    traces = np.trace(across, axis1=1, axis2=2)
    return (np.degrees(np.arccos(np.clip((traces - 1) / 2, -1, 1))),)


def _ours(*given: Any) -> Arrays:
    *views, _ = given
    found = cvkern.stitch(views)
    if not found or len(found[0].members) < len(views):
        return (np.full(len(views) - 1, FAILED),)
    return _angles(found[0].rotations)


def _opencv(cv2: Any, *given: np.ndarray) -> Arrays:
    *views, _ = given
    stitcher = cv2.Stitcher_create()
    status, _ = stitcher.stitch([cv2.cvtColor(view, cv2.COLOR_GRAY2BGR) for view in views])
    if status or len(stitcher.component()) < len(views):
        return (np.full(len(views) - 1, FAILED),)
    # OpenCV's are camera-to-world.
    return _angles(np.stack([np.float64(camera.R).T for camera in stitcher.cameras()]))


CASES = (
    Case(
        name="stitch",
        title="6 views of a camera that turns by 20 degrees, stitched, uint8",
        image=_inputs,
        call=_ours,
        oracle=lambda *given: _angles(given[-1]),
        oracle_name="the angles between the cameras that made the views",
        difference=lambda ours, right: float(np.abs(ours[0] - right[0]).max()),
        tolerance=LIMIT,
        bytes_per_pixel=2,
        operations_per_pixel=0,
        peers=(Peer("OpenCV, Stitcher", "cv2", _opencv, note="leaves views out where it fails"),),
        captures=False,
        work=Work("pixels of views", lambda *given: float(sum(view.size for view in given[:-1]))),
        sizes=("VGA", "1080p"),
        most_inputs=2,
        margin=0,
    ),
)
