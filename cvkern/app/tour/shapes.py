"""Arbitrary shapes: one view of an object in another, and many at once, partly hidden."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import cvkern
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.hough.generalized._poses import placed
from cvkern.images.colors import apply_colormap, luma
from cvkern.images.drawing import draw_lines, draw_points

CUT = (slice(0, 190), slice(130, 320))  # the template's place in the photograph
TURN, SIZE = math.radians(-35), 0.9
EDGES: dict[str, Any] = {"sigma": 2, "low_threshold": 32, "high_threshold": 64}
SCALES = [0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1]
HORSE = 0.3  # size of the silhouette, as a share of its picture's
POSES = (  # row, column, rotation in degrees, scale
    (95, 110, 0, 1.0), (100, 300, 35, 1.2), (92, 500, -60, 0.9), (310, 95, 170, 1.3),
    (195, 62, -20, 0.8), (295, 490, 75, 1.1),
)  # fmt: skip
HERD: dict[str, Any] = {"rotations": 360, "scales": [0.8, 0.9, 1.0, 1.1, 1.2, 1.3]}
OUTLINE, FRAME = (255, 98, 41), (255, 214, 64)


def chapter() -> Chapter:
    """Return the chapter on shapes."""
    return Chapter(
        "shapes",
        "Shapes",
        "A shape is stored as its boundary: for each boundary point, the vector to one reference "
        "point. Every edge point of a photograph then votes for the position of that reference "
        "point.",
        (_one, _many),
    )


def _one(clock: Clock) -> Figure:
    from skimage import data

    photo = data.astronaut()
    template = photo[CUT]
    scene = _turned(photo)
    scene[:, 150:180] = data.brick()[: scene.shape[0], :30, None]
    gray = luma(scene)
    table = cvkern.r_table(luma(template), **EDGES)
    found = _timed(clock, gray, table, rotations=360, scales=SCALES, **EDGES)
    votes = cvkern.generalized_hough_votes(
        gray, table, rotations=found.rotation[:1], scales=found.scale[:1], **EDGES
    )[0, 0]
    # Sum four adjacent cells, as in the search for peaks.
    sums = votes[1:, 1:] + votes[:-1, 1:] + votes[1:, :-1] + votes[:-1, :-1]
    slices = np.kron(np.sqrt(sums), np.ones((4, 4)))
    return Figure(
        "One view in another",
        "The photograph was rotated by 35 degrees and reduced by a tenth, and a strip of bricks "
        f"was put across it. Of {len(table.vectors):,} boundary points of the template, "
        f"{found.support[0]:.0%} were found in place: rotated by "
        f"{math.degrees(found.rotation[0]):.2f} degrees, scale {found.scale[0]:.4f}. The right "
        "picture shows the votes for that rotation and scale, one of 2,520 such planes.",
        'edges = {"sigma": 2, "low_threshold": 32, "high_threshold": 64}\n'
        "table = cvkern.r_table(template, **edges)\n"
        "found = cvkern.generalized_hough(\n"
        "    scene, table, rotations=360,\n"
        "    scales=[0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1],\n"
        "    **edges,\n"
        ")\n"
        "found.position, found.rotation, found.scale",
        (
            Panel("shapes-template", template, "The template, of `skimage.data.astronaut()`"),
            Panel("shapes-one", _drawn(scene, table, found), "The outline in its found pose"),
            Panel("shapes-votes", apply_colormap(slices), "Votes for one rotation and scale"),
        ),
        clock.take(),
    )


def _many(clock: Clock) -> Figure:
    from skimage import data, transform

    # 1 inside the silhouette; reduced with anti-aliasing, so that its edge is smooth.
    silhouette = 1.0 - transform.rescale(data.horse().astype(float), HORSE, anti_aliasing=True)
    template = (200 * (1 - silhouette) + 10 * silhouette).astype(np.float32)
    scene = data.coffee().astype(np.float32)
    for row, column, degrees, scale in POSES:
        share = _stamp(silhouette, scene.shape[:2], (row, column), math.radians(degrees), scale)
        scene += share[..., None] * (10 - scene)
    scene[340:, 40:150] = 225
    scene[250:330, 470:500] = 225
    picture = scene.round().astype(np.uint8)
    table = cvkern.r_table(template)
    found = _timed(clock, luma(picture), table, num_peaks=6, **HERD)
    return Figure(
        "Many at once",
        "Six silhouettes, rotated and scaled, on a photograph; two are partly covered. One call "
        f"finds all of them, with {found.support.min():.0%} to {found.support.max():.0%} of "
        "their boundary.",
        "table = cvkern.r_table(horse)\n"
        "found = cvkern.generalized_hough(\n"
        "    scene, table, rotations=360, num_peaks=6,\n"
        "    scales=[0.8, 0.9, 1.0, 1.1, 1.2, 1.3],\n"
        ")",
        (
            Panel("shapes-scene", picture, "`skimage.data.coffee()` and `skimage.data.horse()`"),
            Panel("shapes-many", _drawn(picture, table, found), "What was found"),
        ),
        clock.take(),
    )


def _timed(clock: Clock, image: np.ndarray, table: cvkern.RTable, **options: Any) -> cvkern.Shapes:
    """Return the shapes, and time the call without listing the table as an option."""

    def generalized_hough(image: np.ndarray, **options: Any) -> cvkern.Shapes:
        return cvkern.generalized_hough(image, table, **options)

    return clock(generalized_hough, image, **options)


def _turned(photo: np.ndarray) -> np.ndarray:
    """Return the photograph rotated about its centre and scaled, on its mean colour."""
    from skimage import transform

    centre = (np.array(photo.shape[1::-1]) - 1) / 2
    back = transform.AffineTransform(translation=-centre)
    there = transform.AffineTransform(translation=centre)
    turn = transform.SimilarityTransform(scale=SIZE, rotation=TURN)
    edge = float(photo.mean())
    moved = transform.warp(
        photo, (back + turn + there).inverse, order=3, cval=edge, preserve_range=True
    )
    return moved.clip(0, 255).round().astype(np.uint8)


def _stamp(
    silhouette: np.ndarray,
    shape: tuple[int, ...],
    place: tuple[int, int],
    rotation: float,
    scale: float,
) -> np.ndarray:
    """Return the silhouette in a pose, on an empty picture."""
    from skimage import transform

    middle = (np.array(silhouette.shape[::-1]) - 1) / 2
    to = transform.AffineTransform(translation=-middle)
    turn = transform.SimilarityTransform(scale=scale, rotation=rotation, translation=place[::-1])
    return transform.warp(silhouette, (to + turn).inverse, output_shape=shape, order=1)


def _drawn(image: np.ndarray, table: cvkern.RTable, found: cvkern.Shapes) -> np.ndarray:
    """Return the picture with outline and frame of each shape."""
    last = np.array(table.shape) - 1
    corners = np.array([[0, 0], [0, 1], [1, 1], [1, 0]]) * last - table.reference
    for position, rotation, scale in zip(*found[:3], strict=True):
        frame = placed(corners, position, float(rotation), float(scale))
        image = draw_lines(image, np.hstack((frame, np.roll(frame, -1, axis=0))), color=FRAME)
        outline = placed(-table.vectors, position, float(rotation), float(scale))
        image = draw_points(image, outline, color=OUTLINE, radius=1.2)
    return image
