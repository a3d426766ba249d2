"""Hough transforms: lines, circles, ellipses, and any shape."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import (
    EDGES,
    IMAGE,
    MASK,
    Call,
    Draw,
    Maker,
    angles,
    columns,
    dists,
    image,
    mask,
    maybe,
    number,
    one,
    points,
    several,
    stack,
    table,
    whole,
)

DETECT = {name: make for name, make in EDGES.items() if name != "use_quantiles"}
DIRECTED: dict[str, Maker] = {"orientation": angles, "orientation_tolerance": number(0, 3)}
RANGE = one((3, 9), (4.5, 20), (3, 3), (20, 5), (1, 2))
SHAPE_OPTIONS: dict[str, Maker] = {
    **EDGES,
    "rotations": one(None, 1, 5, [0.1, 2.0], [-200.0]),
    "scales": one(None, [1.0], [0.5, 2], [99.0]),
    "cell": one(4, 1, 2, np.uint8(2), np.int64(8), 3),
    "max_entries": whole(1, 40),
    "orientation_tolerance": maybe(number(0, 0.5)),
}


def small(draw: Draw) -> Any:
    """Return a picture of at most 40 x 40 pixels: all of them may vote for all of the shape's."""
    height, width = draw.shape
    return image(draw._replace(shape=(min(height, 40), min(width, 40))))


TRIES: dict[str, Maker] = {"threshold": number(0, 1), "num_peaks": maybe(whole(0, 5))}

CALLS: dict[str, Call] = {
    "hough_line": Call(
        cvkern.hough_line,
        MASK,
        {
            **DIRECTED,
            "theta": several(number(-1.5, 1.5)),
            "rho_step": number(0.1, 9),
            "weights": image,
        },
    ),
    "hough_line points": Call(
        cvkern.hough_line,
        {"points": points, "shape": lambda draw: draw.shape},
        {"theta": several(number(-1.5, 1.5)), "rho_step": number(0.1, 9)},
    ),
    "hough_line_slope": Call(
        cvkern.hough_line_slope,
        MASK,
        {
            "slopes": several(number(-1, 1)),
            "intercepts": one(None, [0, 1], [-5.5, 1, 7.5], [0, 1e13]),
        },
    ),
    "hough_line_peaks": Call(
        cvkern.hough_line_peaks,
        {"hspace": image, "angles": columns, "dists": dists},
        {
            "min_distance": whole(0, 12),
            "min_angle": whole(0, 12),
            "threshold": maybe(number(-5, 300)),
            "num_peaks": whole(0, 9),
            "refine": one(False, True),
        },
    ),
    "probabilistic_hough_line": Call(
        cvkern.probabilistic_hough_line,
        {"image": mask, "rng": whole(0, 9)},  # None: the order is another in each call
        {
            "threshold": whole(0, 20),
            "line_length": whole(0, 30),
            "line_gap": whole(0, 9),
            "theta": several(number(-1.5, 1.5)),
        },
        but=lambda given: given.get("rng") is None,
    ),
    "hough_line_segments": Call(
        cvkern.hough_line_segments,
        {**MASK, "theta": one([0.3], [0.0, 1.2], []), "rho": one([3.0], [5.0, 9.0], [])},
        {**DIRECTED, "min_length": number(0, 9), "max_gap": number(0, 5), "distance": number(0, 3)},
    ),
    "fit_line": Call(cvkern.fit_line, {"points": points}, {"weights": several(number(0, 1))}),
    "suggest_line_bins": Call(
        cvkern.suggest_line_bins,
        {"shape": lambda draw: draw.shape},
        {"localisation": number(0.05, 2), "length": maybe(number(1, 99))},
    ),
    "detect_lines": Call(
        cvkern.detect_lines,
        IMAGE,
        {**EDGES, "min_votes": maybe(number(2, 20)), "distance": number(0.2, 3)},
        equal=False,
    ),
    "detect_segments": Call(
        cvkern.detect_segments,
        IMAGE,
        {**EDGES, "min_length": number(2, 20), "max_gap": number(0, 5), "distance": number(0.2, 3)},
        equal=False,
    ),
    "hough_circle": Call(
        cvkern.hough_circle,
        {**MASK, "radius": one(3, [2, 5], 0, [9], [-1], [1.5])},
        {**DIRECTED, "normalize": one(True, False), "full_output": one(False, True)},
    ),
    "hough_circle_peaks": Call(
        cvkern.hough_circle_peaks,
        {"hspaces": stack, "radii": one([3], [3, 6])},
        {
            "min_xdistance": whole(0, 5),
            "min_ydistance": whole(0, 5),
            "num_peaks": whole(1, 5),
            "threshold": maybe(number(0, 1)),
            "total_num_peaks": whole(1, 9),
            "normalize": one(False, True),
        },
    ),
    "hough_ellipse": Call(
        cvkern.hough_ellipse,
        {"mask": lambda draw: draw.rng.random(draw.shape) < 0.02},
        {
            "threshold": whole(0, 20),
            "accuracy": number(0.5, 5),
            "min_size": number(0, 9),
            "max_size": maybe(number(4, 40)),
            **DIRECTED,
        },
    ),
    "detect_circles": Call(
        cvkern.detect_circles,
        IMAGE,
        {
            **DETECT,
            "sigma": maybe(DETECT["sigma"]),
            "radius_range": maybe(RANGE),
            "polarity": one("any", "bright", "dark"),
            "min_support": number(0.01, 1),
            "min_distance": maybe(number(0, 20)),
        },
    ),
    "detect_ellipses": Call(
        cvkern.detect_ellipses,
        {**IMAGE, "axis_range": RANGE},
        {
            **DETECT,
            "min_support": number(0.01, 1),
            "max_points": whole(3, 300),
            "min_distance": maybe(number(0, 9)),
        },
        equal=False,
    ),
    "r_table": Call(
        cvkern.r_table,
        {"template": image},
        {**EDGES, "reference": maybe(one((3, 4), (0.5, -9), (1, np.nan))), "orientation": angles},
    ),
    "generalized_hough": Call(
        cvkern.generalized_hough,
        {**IMAGE, "table": table},
        {
            **SHAPE_OPTIONS,
            **TRIES,
            "orientation": angles,
            "min_distance": maybe(number(0, 9)),
            "min_rotation": number(0, 3),
            "min_ratio": number(1, 9),
            "max_bytes": whole(1, 2**28),
        },
        equal=False,
    ),
    "generalized_hough_votes": Call(
        cvkern.generalized_hough_votes,
        {**IMAGE, "table": table},
        {**SHAPE_OPTIONS, "orientation": angles},
    ),
    "detect_shape": Call(
        cvkern.detect_shape,
        {"template": small, "scene": small},
        {
            **SHAPE_OPTIONS,
            **TRIES,
            "rotations": whole(1, 9),
            "reference": maybe(one((3, 4), (0.5, -9))),
        },
        equal=False,
    ),
}
