"""Votes over tiles: sums of integers, so they are those of the whole image."""

from __future__ import annotations

from collections.abc import Iterable
from inspect import signature
from typing import Any

import numpy as np

import cvkern
from cvkern._checks import check_accumulator, check_number, check_positive, check_sides
from cvkern._runtime import runtime
from cvkern.hough._points import mask_points
from cvkern.hough.generalized._ballot import EDGE_OPTIONS, scene_of
from cvkern.hough.generalized._poses import Scene
from cvkern.hough.lines._tables import (
    cast_votes,
    crossing,
    direction_windows,
    line_tables,
    moved,
    reach,
)
from cvkern.hough.lines.votes import HoughLine, check_angles, hough_line

Windows = Iterable[tuple[Any, np.ndarray, dict[str, np.ndarray]]]
"""The windows of an image; each comes with its tile and what lies beside it."""


def shape_votes(
    name: str, windows: Windows, shape: tuple[int, ...], options: dict[str, Any]
) -> Any:
    """Return the shapes, or the votes for them, of a mask with orientation.

    Its edge points are gathered, which are few beside its pixels. `options` are those of the
    function.
    """
    given = signature(getattr(cvkern, name)).bind(None, **options)
    given.apply_defaults()
    edges = tuple(given.arguments[option] for option in EDGE_OPTIONS)
    scenes = []
    for tile, window, beside in windows:
        found = scene_of(window, beside["orientation"], edges, "image")
        corner = tile.inner[0].start, tile.inner[1].start
        scenes.append((found.points + np.array(corner, np.int32), found.codes))
    points, codes = (np.concatenate(parts) for parts in zip(*scenes, strict=True))
    order = np.lexsort((points[:, 1], points[:, 0]))
    whole = Scene(points[order], codes[order], (int(shape[0]), int(shape[1])))
    return getattr(cvkern, name)(whole, **options)


def line_votes(
    windows: Windows,
    shape: tuple[int, ...],
    options: dict[str, Any],
) -> HoughLine:
    """Add the votes of windows; `options` are those of :func:`cvkern.hough_line`."""
    given = signature(hough_line).bind(None, **options)
    given.apply_defaults()
    angles = check_angles(given.arguments["theta"])
    step = check_positive(given.arguments["rho_step"], "rho_step")
    tolerance = given.arguments["orientation_tolerance"]
    tolerance = check_number(tolerance, "orientation_tolerance", low=0)
    size = check_sides(shape, "source")
    distances = reach(size, step)
    check_accumulator((2 * distances + 1, len(angles)), "votes")
    tables = line_tables(angles.tobytes(), step, size, 1)
    total = np.zeros((2 * distances + 1, len(angles)), np.int64)
    for tile, window, beside in windows:
        orientation, weights = beside.get("orientation"), beside.get("weights")
        directions = None
        if orientation is not None:
            directions = direction_windows(angles.tobytes(), tolerance)
        rt = runtime(window)
        found = mask_points(rt, window, "hough_line")
        votes = rt.scratch("scale.votes", total.shape, np.int32)
        corner = tile.inner[0].start, tile.inner[1].start
        cast_votes(
            rt, found, moved(tables, corner), directions, orientation, weights,
            crossing(size, step), votes,
        )  # fmt: skip
        total += rt.to_numpy(votes)
    if total.max(initial=0) >= 2**31:
        raise ValueError(f"weights must be small enough for votes below 2^31, got {total.max()}")
    rho = step * np.arange(-distances, distances + 1.0)
    return HoughLine(total.astype(np.int32), angles, rho)
