"""Dense stereo: its steps, and what is made of disparities."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import (
    Call,
    Draw,
    alike,
    colour,
    costs,
    disparities,
    disparity,
    guide,
    image,
    many_colours,
    mask,
    maybe,
    number,
    one,
    whole,
)

Q = np.array([[1, 0, 0, -20], [0, 1, 0, -10], [0, 0, 0, 700], [0, 0, 8.0, 0]])


K = np.array([[100.0, 0, 64], [0, 100, 48], [0, 0, 1]])


def view(draw: Draw) -> Any:
    """Return one view of a slanted wall, or any image."""
    if draw.odd(0.1):
        return colour(draw)
    wall = np.kron(np.random.default_rng(draw.salt).random((16, 30)), np.ones((4, 4)))
    begin = int(draw.pick([0, 3, 6, 20]))
    return (255 * wall[:, begin : begin + 85]).astype(draw.pick(["uint8", "uint8", "uint16"]))


def side(draw: Draw) -> Any:
    """Return a view of a pair, both of one dtype."""
    values = draw.rng.random(draw.shape)
    dtype = alike(draw).pick(["uint8", "uint8", "f4", "uint16", "i8"])
    return (values * (1 if dtype == "f4" else 255)).astype(dtype) if draw.odd(0.9) else image(draw)


def pixels(draw: Draw) -> Any:
    """Return the colours of a disparity map."""
    shape = draw.pick([draw.shape, (*draw.shape, 3)])
    return draw.rng.integers(0, 256, shape).astype(np.uint8) if draw.odd(0.9) else colour(draw)


def matched(shape: Any, disparities: Any, left: Any, right: Any) -> Any:
    """Make a matcher and match a pair."""
    with cvkern.StereoMatcher(shape, disparities) as matcher:
        return tuple(matcher(left, right))


def not_finite(arguments: dict[str, Any]) -> bool:
    """Tell whether values are not finite and the cost makes no promise for such values."""
    if arguments.get("cost") not in ("zncc", "birchfield_tomasi"):
        return False
    images = (np.asarray(arguments[side]) for side in ("left", "right"))
    return not all(np.isfinite(image.astype(np.float32)).all() for image in images)


CALLS: dict[str, Call] = {
    "stereo_cost": Call(
        cvkern.stereo_cost,
        {"left": image, "right": image, "disparities": disparities},
        {
            "cost": one("census", "sad", "ssd", "zncc", "birchfield_tomasi", "birchfield-tomasi"),
            "window": maybe(one(1, 3, 5, (3, 7), 4)),
            "neighborhood": one((7, 9), 5, (3, 3), (9, 9)),
            "spacing": whole(1, 3),
        },
        but=not_finite,
    ),
    "aggregate_semi_global": Call(
        cvkern.aggregate_semi_global,
        {"costs": costs, "p1": whole(0, 40), "p2": whole(0, 90)},
        {
            "paths": one(4, 8, 16, 5),
            "contrast": number(0.5, 50),
            "largest_cost": maybe(whole(1, 99)),
            "guide": maybe(guide),
            "max_bytes": maybe(whole(1, 2**20)),
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
            "speckle_difference": number(0, 5),
            "max_bytes": maybe(whole(1, 2**20)),
        },
    ),
    "StereoMatcher": Call(
        matched,
        {
            "shape": lambda draw: draw.shape,
            "disparities": disparities,
            "left": side,
            "right": side,
        },
        {},
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
        {"disparity": disparity, "guide": guide},
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
    "stereo_cost of colours": Call(
        cvkern.stereo_cost,
        {
            "left": many_colours,
            "right": many_colours,
            "disparities": disparities,
            "channel_axis": one(-1, -1, -1, 2),
        },
        {"cost": one("sad", "census")},
    ),
    "point_cloud": Call(
        cvkern.point_cloud,
        {"disparity": disparity, "q": lambda draw: Q, "image": pixels},
        {"valid": mask},
    ),
    "reconstruct_pair": Call(
        cvkern.reconstruct_pair,
        {"image0": view, "image1": view, "K": one(K, K, np.stack((K, K)), np.eye(3), None)},
        {
            "baseline": maybe(number(0.01, 9)),
            "threshold": number(0.1, 9),
            "max_keypoints": whole(1, 400),
            "max_ratio": number(0.1, 1),
            "max_side": one(64, 100, 1600, 63),
            "seed": whole(0, 9),
        },
        equal=False,
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
}
