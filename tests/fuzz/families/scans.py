"""From decoded light to points in space."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import Call, Draw, image, mask, maybe, number, one, whole
from tests.fuzz.families.cameras import CAMERA

SCAN = cvkern.make_scan("gray_code", (12, 16), (12, 16), seed=1)
AXIS = one("columns", "rows", "none")


def places(draw: Draw) -> Any:
    """Return columns of a projector that the pixels of a camera see, some NaN."""
    if draw.odd(0.2):
        return image(draw)
    found = draw.rng.uniform(0, 16, (12, 16)).astype(np.float32)
    found[draw.rng.random((12, 16)) < 0.1] = np.nan
    return found


def lines(draw: Draw) -> Any:
    """Return places of laser lines in some frames, some NaN."""
    if draw.odd(0.2):
        return image(draw)
    found = draw.rng.uniform(0, 48, (int(draw.pick([1, 3])), 64))
    found[draw.rng.random(found.shape) < 0.1] = np.nan
    return found


def plane(draw: Draw) -> Any:
    """Return a plane, or any four numbers."""
    return draw.pick([(0, 0.6, 0.8, -1.0), (0, 0, 0, 1), draw.rng.normal(size=4), (1, 2)])


CALLS: dict[str, Call] = {
    "make_scan": Call(
        cvkern.make_scan,
        {"kind": one("gray_code", "phase_shift", "laser", "none")},
        {
            "shape": one((24, 32), (12, 16), (1, 1), (0, 3)),
            "projector_shape": one((24, 32), (1, 1), (0, 3)),
            "frames": whole(0, 4),
            "noise": number(0, 3),
            "seed": whole(0, 9),
        },
    ),
    "triangulate_columns": Call(
        cvkern.triangulate_columns,
        {"columns": places, "calibration": one(SCAN.calibration)},
        {"valid": maybe(mask), "axis": AXIS},
    ),
    "triangulate_lines": Call(
        cvkern.triangulate_lines,
        {"positions": lines, "camera": CAMERA, "plane": plane},
        {
            "axis": one(0, 1, 2),
            "angles": maybe(one((0, 0.1, 0.2), (0,), (np.nan,))),
            "pivot": maybe(one((0, 0, 1), (1, 2))),
            "spindle": one((0, -1, 0), (0, 0, 0), (1, 2)),
        },
    ),
}
