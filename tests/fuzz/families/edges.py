"""Edges: pixels and points."""

from __future__ import annotations

import cvkern
from tests.fuzz.arguments import BORDER, EDGES, IMAGE, MASK, Call, channels, one

CALLS: dict[str, Call] = {
    "canny": Call(
        cvkern.canny,
        IMAGE,
        {
            **EDGES,
            **BORDER,
            **MASK,
            "operator": one("gaussian", "sobel", "scharr"),
            "suppression": one("interpolated", "sectors"),
            "norm": one("l1", "l2"),
        },
    ),
    "canny of stacks": Call(
        cvkern.canny,
        {"image": channels, "batch_axis": one(0, 0, 0, None, 1)},
        {**EDGES, **BORDER, "norm": one("l1", "l2")},
    ),
    "subpixel_edges": Call(cvkern.subpixel_edges, IMAGE, {**EDGES, **BORDER}, equal=False),
    "subpixel_edges of stacks": Call(
        cvkern.subpixel_edges,
        {"image": channels, "batch_axis": one(0, 0, 0, None, 1)},
        {**EDGES, **BORDER},
        equal=False,
    ),
}
