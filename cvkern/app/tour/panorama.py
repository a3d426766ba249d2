"""Panoramas: from matches between two photographs to a picture of all."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.images.drawing import draw_lines

COLOUR = (255, 98, 41)
SHOWN = 80  # matches that are drawn
FOCAL = 520.0  # pixels, of the cameras that the views are made with
SIDES = 330, 260  # height and width of a view
DEGREES = (10.0, -11.0, 0.0)
LIGHT = (1.0, 1.0, 0.7)


def chapter() -> Chapter:
    """Return the chapter on panoramas."""
    return Chapter(
        "panorama",
        "Panoramas",
        "Photographs of one scene, from a camera that turns, are put together. They may lie in a "
        "heap, in any order, among others.",
        (_pair, _whole),
    )


def views() -> list[np.ndarray]:
    """Return photographs by a camera that turns before a picture, the last with less light."""
    from skimage import data

    photo = data.coffee()
    height, width = photo.shape[:2]
    made = []
    for degrees, light in zip(DEGREES, LIGHT, strict=True):
        a = np.radians(degrees)
        turn = np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
        matrix = _camera(*SIDES) @ turn @ np.linalg.inv(_camera(height, width))
        view = cvkern.warp_perspective(photo, matrix, SIDES, channel_axis=-1)
        made.append((light * view).astype(np.uint8))
    return made


def _camera(height: int, width: int) -> np.ndarray:
    return np.array([[FOCAL, 0, (width - 1) / 2], [0, FOCAL, (height - 1) / 2], [0, 0, 1]])


def _pair(clock: Clock) -> Figure:
    one, other = views()[1:]
    points = [cvkern.sift(view, 1000) for view in (one, other)]
    matches = cvkern.match_descriptors(points[0].descriptors, points[1].descriptors, 0.75)
    places = [p.points[matches[:, k]] for k, p in enumerate(points)]
    fit = clock(cvkern.find_homography, *places)
    table = np.hstack(places)[fit.inliers]
    drawn = table[:: max(1, len(table) // SHOWN)] + np.array([0, 0, 0, one.shape[1]])
    both = np.hstack((one, other))
    return Figure(
        "Two photographs of one scene",
        f"Of {len(matches)} matches between the keypoints of two views, {int(fit.inliers.sum())} "
        "agree on one homography, which no two strangers have. The right view was taken with "
        "less light.",
        "fit = cvkern.find_homography(points0, points1)",
        (
            Panel(
                "panorama-matches",
                draw_lines(both, drawn, color=COLOUR, width=1.0),
                f"{len(drawn)} of the matches that agree",
            ),
        ),
        clock.take(),
    )


def _whole(clock: Clock) -> Figure:
    from skimage import data

    heap = [data.chelsea()[:, 90:350], *views()]

    def stitch(first: np.ndarray, *others: np.ndarray, **options: Any) -> list[cvkern.Panorama]:
        return cvkern.stitch([first, *others], **options)

    (found,) = clock(stitch, *heap, crop=True)
    focal = float(np.median(found.focal_lengths))
    shown = [view[: SIDES[0]] for view in heap]
    tall = [np.pad(v, ((0, SIDES[0] - len(v)), (6, 6), (0, 0)), constant_values=255) for v in shown]
    return Figure(
        "A panorama from a heap",
        "Every pair of the heap was compared: the cat belongs to nobody. The cameras' angles and "
        f"their focal length come from the matches alone: {focal:.0f} pixels, where the views were "
        f"made with {FOCAL:.0f}. Gains make the exposures alike, seams run where the views agree, "
        "and each band of the pictures is blended over a width of its own.",
        "(panorama,) = cvkern.stitch(heap, crop=True)",
        (
            Panel("panorama-heap", np.hstack(tall), "The heap"),
            Panel("panorama-whole", found.image, "What belongs together, cut to a rectangle"),
        ),
        clock.take(),
    )
