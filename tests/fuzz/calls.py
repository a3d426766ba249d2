"""How each public function is called: a maker for each of its parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import cvkern
import cvkern.images
from tests.fuzz.arguments import (
    MODES,
    NONSENSE,
    Draw,
    angles,
    costs,
    disparity,
    image,
    mask,
    maybe,
    number,
    one,
    pair,
    points,
    rows,
    several,
    table,
    whole,
)

Maker = Callable[[Draw], Any]


class Call(NamedTuple):
    """A function, makers of its arguments, and whether both kernel sets give the same bits."""

    function: Callable[..., Any]
    needed: dict[str, Maker]
    options: dict[str, Maker]
    equal: bool = True


def stack(draw: Draw) -> Any:
    """Return votes of several circles."""
    return draw.rng.random((int(draw.pick([1, 2])), *draw.shape)).astype(np.float32)


def colour(draw: Draw) -> Any:
    """Return a picture to draw on."""
    shape = draw.pick([draw.shape, (*draw.shape, 3), (*draw.shape, 4)])
    return draw.rng.integers(0, 256, shape).astype(np.uint8) if draw.odd(0.9) else image(draw)


def disparities(draw: Draw) -> Any:
    """Return a range that mostly fits the width."""
    first = int(draw.rng.integers(-3, 3))
    return first, first + int(draw.rng.integers(1, max(2, min(draw.shape[1], 33))))


def dists(draw: Draw) -> Any:
    """Return as many distances as the image has rows."""
    return np.arange(draw.shape[0]) * 1.0


def columns(draw: Draw) -> Any:
    """Return as many angles as the image has columns."""
    return np.linspace(-1.5, 1.5, draw.shape[1])


BORDER: dict[str, Maker] = {"mode": one(*MODES), "cval": number(-5, 300)}
EDGES: dict[str, Maker] = {
    "sigma": number(0, 4),
    "low_threshold": maybe(number(0, 1)),
    "high_threshold": maybe(number(0, 300)),
    "use_quantiles": one(False, False, True),
}
DETECT = {name: make for name, make in EDGES.items() if name != "use_quantiles"}
DIRECTED: dict[str, Maker] = {"orientation": angles, "orientation_tolerance": number(0, 3)}
IMAGE: dict[str, Maker] = {"image": image}
MASK: dict[str, Maker] = {"mask": mask}
RANGE = one((3, 9), (4.5, 20), (3, 3), (20, 5), (1, 2))
Q = np.array([[1, 0, 0, -20], [0, 1, 0, -10], [0, 0, 0, 700], [0, 0, 8.0, 0]])
SHAPE_OPTIONS: dict[str, Maker] = {
    **EDGES,
    "rotations": one(None, 1, 5, [0.1, 2.0], [-200.0]),
    "scales": one(None, [1.0], [0.5, 2], [99.0]),
    "cell": one(4, 1, 2, np.uint8(2), np.int64(8), 3),
    "max_entries": whole(1, 40),
    "orientation_tolerance": maybe(number(0, 0.5)),
}
TRIES: dict[str, Maker] = {"threshold": number(0, 1), "num_peaks": maybe(whole(0, 5))}

CALLS: dict[str, Call] = {
    "gaussian": Call(
        cvkern.gaussian,
        IMAGE,
        {
            **BORDER,
            "sigma": pair(number(0, 8)),
            "order": pair(whole(0, 3)),
            "truncate": number(0, 6),
        },
    ),
    "box": Call(cvkern.box, IMAGE, {**BORDER, "radius": pair(whole(0, 30))}),
    "correlate_separable": Call(
        cvkern.correlate_separable, {**IMAGE, "taps": several(number(-2, 2), 1, 7)}, BORDER
    ),
    "median": Call(cvkern.median, IMAGE, {**BORDER, "radius": whole(0, 8)}),
    "sobel": Call(cvkern.sobel, IMAGE, {**BORDER, "axis": one(None, 0, 1, 2, -1)}),
    "scharr": Call(cvkern.scharr, IMAGE, {**BORDER, "axis": one(None, 0, 1)}),
    "gradient": Call(
        cvkern.gradient,
        IMAGE,
        {**BORDER, "sigma": number(0, 5), "operator": one("gaussian", "sobel", "scharr")},
    ),
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
    "subpixel_edges": Call(cvkern.subpixel_edges, IMAGE, {**EDGES, **BORDER}, equal=False),
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
            "orientation": angles,
        },
    ),
    "detect_circles": Call(
        cvkern.detect_circles,
        {**IMAGE, "radius_range": RANGE},
        {
            **DETECT,
            "polarity": one("any", "bright", "dark"),
            "min_support": number(0.01, 1),
            "min_distance": maybe(number(0, 20)),
        },
    ),
    "detect_ellipses": Call(
        cvkern.detect_ellipses,
        {**IMAGE, "axis_range": RANGE},
        {**DETECT, "min_support": number(0.01, 1), "max_points": whole(3, 300)},
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
    "find_shape": Call(
        cvkern.find_shape,
        {"template": image, "scene": image},
        {**SHAPE_OPTIONS, **TRIES, "rotations": whole(1, 9)},
        equal=False,
    ),
    "stereo_cost": Call(
        cvkern.stereo_cost,
        {"left": image, "right": image, "disparities": disparities},
        {
            "cost": one("census", "sad", "ssd", "zncc", "birchfield_tomasi", "birchfield-tomasi"),
            "window": maybe(one(1, 3, 5, (3, 7), 4)),
            "neighborhood": one((7, 9), 5, (3, 3), (9, 9)),
            "spacing": whole(1, 3),
        },
    ),
    "aggregate_semi_global": Call(
        cvkern.aggregate_semi_global,
        {"costs": costs, "p1": whole(0, 40), "p2": whole(0, 90)},
        {
            "paths": one(4, 8, 16, 5),
            "contrast": number(0.5, 50),
            "largest_cost": maybe(whole(1, 99)),
        },
    ),
    "winner_take_all": Call(
        cvkern.winner_take_all,
        {"costs": costs},
        {
            "first": whole(-9, 9),
            "subpixel": one(True, False, "equiangular", "parabola"),
            "uniqueness": whole(0, 99),
        },
    ),
    "stereo_match": Call(
        cvkern.stereo_match,
        {"left": image, "right": image, "disparities": disparities},
        {
            "method": one("semi-global", "window"),
            "paths": one(4, 8),
            "window": one(3, 11, 4),
            "p1": whole(0, 40),
            "p2": whole(0, 99),
            "contrast": number(1, 40),
            "subpixel": one(True, False, "equiangular"),
            "uniqueness": whole(0, 50),
            "left_right": maybe(number(0, 3)),
            "speckle_size": whole(0, 30),
            "smoothing": whole(0, 7),
            "data_range": maybe(number(1, 300)),
        },
    ),
    "left_right_check": Call(
        cvkern.left_right_check,
        {"disparity": disparity, "right": disparity},
        {"tolerance": number(0, 3)},
    ),
    "remove_speckles": Call(
        cvkern.remove_speckles,
        {"disparity": disparity},
        {"min_size": whole(0, 50), "difference": number(0, 5)},
    ),
    "fill_disparity": Call(cvkern.fill_disparity, {"disparity": disparity}, {}),
    "guided_median": Call(
        cvkern.guided_median,
        {"disparity": disparity, "guide": image},
        {"radius": whole(0, 8), "contrast": whole(1, 99)},
    ),
    "disparity_to_depth": Call(
        cvkern.disparity_to_depth,
        {"disparity": disparity, "focal": number(1, 900), "baseline": number(0.01, 3)},
        {"doffs": number(-9, 9)},
    ),
    "points_from_disparity": Call(
        cvkern.points_from_disparity, {"disparity": disparity, "q": lambda draw: Q}, {}
    ),
    "point_cloud": Call(
        cvkern.point_cloud,
        {"disparity": disparity, "q": lambda draw: Q, "image": colour},
        {"valid": mask},
    ),
    "reprojection_matrix": Call(
        cvkern.reprojection_matrix,
        {
            "focal": number(1, 99),
            "baseline": number(0.1, 2),
            "cx": number(0, 9),
            "cy": number(0, 9),
        },
        {"doffs": number(-9, 9)},
    ),
    "images.apply_colormap": Call(
        cvkern.images.apply_colormap,
        {"values": image},
        {
            "name": one("sequential", "cyclic", "diverging", "none"),
            "vmin": maybe(number(-9, 9)),
            "vmax": maybe(number(-9, 300)),
        },
    ),
    "images.draw_points": Call(
        cvkern.images.draw_points,
        {"image": colour, "points": rows(2)},
        {"radius": one(0.5, 2.0, 30.0, 1e6, 1e300), "color": one((1, 2, 3), (300, 0, 0))},
    ),
    "images.draw_lines": Call(
        cvkern.images.draw_lines,
        {"image": colour, "segments": rows(4)},
        {"width": one(0.5, 2.0, 30.0, 1e6, 1e300)},
    ),
    "images.draw_circles": Call(
        cvkern.images.draw_circles,
        {"image": colour, "circles": rows(3)},
        {"width": one(0.5, 2.0, 30.0, 1e6, 1e300)},
    ),
    "images.draw_epipolar_lines": Call(
        cvkern.images.draw_epipolar_lines,
        {
            "image": colour,
            "F": one(np.array([[0, 0, 0], [0, 0, -1], [0, 1, 0.5]])),
            "points": rows(2),
        },
        {"width": one(0.5, 2.0, 30.0, 1e6, 1e300), "side": one(0, 1, 2)},
    ),
    "images.overlay_mask": Call(
        cvkern.images.overlay_mask, {"image": colour, "mask": mask}, {"opacity": number(0, 1)}
    ),
    "images.luma": Call(cvkern.images.luma, {"image": colour}, {"channel_axis": one(-1, 2, 0)}),
}
EVERY = list(CALLS)
NOT_CALLED = {"use", "capture", "devices", "release_memory"}  # they compute nothing of their own


def draw_call(draw: Draw) -> tuple[str, dict[str, Any]]:
    """Return the name of a call and its arguments, one of which may be nonsense."""
    name = draw.pick(EVERY)
    call = CALLS[name]
    chosen = {key: make(draw) for key, make in call.needed.items()}
    chosen |= {key: make(draw) for key, make in call.options.items() if draw.odd(0.35)}
    if draw.odd(0.2):
        chosen[draw.pick([*call.needed, *call.options])] = draw.pick(NONSENSE)
    return name, chosen
