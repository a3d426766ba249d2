"""Reconstruction: from photographs to their cameras, and points of the scene."""

from __future__ import annotations

import numpy as np

import cvkern
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.radiance import make_scene

VIEWS, SIDE = 12, 240
FOCAL = 1.5 * SIDE  # pixels; cameras with it make the photographs
SHEET = 2, 5  # rows and columns of photographs that are shown


def chapter() -> Chapter:
    """Return the chapter on reconstruction."""
    return Chapter(
        "reconstruction",
        "Cameras from photographs",
        "Photographs of one scene, in any order, tell where each of them was taken from. Radiance "
        "fields begin with that.",
        (_cameras,),
    )


def _cameras(clock: Clock) -> Figure:
    scene = make_scene(layout="forward", train=VIEWS, test=0, size=SIDE, texture=True)
    photographs = scene.images[..., :3]
    found = clock(cvkern.reconstruct, photographs, focal_lengths=FOCAL)
    rows, columns = SHEET
    shown = photographs[: rows * columns].reshape(rows, columns, SIDE, SIDE, 3)
    sheet = np.vstack([np.hstack(list(row)) for row in shown])
    return Figure(
        "Where the photographs were taken from",
        f"{len(found.placed)} of {VIEWS} photographs have found their places, with "
        f"{len(found.points)} points of the scene. On average a point is projected "
        f"{found.errors.mean():.2f} pixels from where a photograph shows it.",
        "found = cvkern.reconstruct(photographs, focal_lengths=360)",
        (
            Panel("reconstruction-photographs", sheet, "Some of the photographs"),
            Panel("reconstruction-cameras", found.picture(2 * SIDE), "Cameras and points"),
        ),
        clock.take(),
    )
