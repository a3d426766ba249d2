"""Panoramas of small images, bundles of a few cameras, and reconstructions."""

from __future__ import annotations

import tempfile
from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import (
    Call,
    Draw,
    Maker,
    channels,
    image,
    maybe,
    number,
    one,
    several,
    whole,
)


def heap(draw: Draw) -> Any:
    """Return overlapping parts of one picture, or images that have nothing in common."""
    if draw.odd(0.5):
        return several(image if draw.odd(0.7) else channels, 0, 3)(draw)
    coarse = draw.rng.random((12, 22))
    wide = np.kron(coarse, np.ones((5, 5)))
    parts = [wide[:, :82], wide[:, 25:]]
    if draw.odd(0.3):
        parts = [np.repeat(part[..., None], 3, 2) for part in parts]
    return [(255 * part).astype(draw.pick(["uint8", "float32"])) for part in parts]


CAMERA = cvkern.Camera([[60, 0, 40], [0, 60, 30], [0, 0, 1]], [-0.1], (60, 80))
COUNT = 8


def poses(draw: Draw) -> Any:
    """Return cameras side by side, or any arrays."""
    if draw.odd(0.1):
        return image(draw)
    found = np.stack([np.eye(3, 4)] * 3)
    found[:, 0, 3] = np.arange(3) + draw.rng.normal(0, 0.05, 3)
    return found


def points(draw: Draw) -> Any:
    """Return points before the cameras, some of them far away or behind."""
    found = draw.rng.uniform((-1, -1, 3), (3, 1, 6), (COUNT, 3))
    if draw.odd(0.2):
        found[0] = draw.pick([(0, 0, 0), (0, 0, -4), (1e9, 0, 1e9), (np.nan, 0, 1)])
    return found


def tracks(draw: Draw) -> Any:
    """Return all pairs of a point and a camera, or some with mistakes."""
    found = np.array([(p, n) for p in range(COUNT) for n in range(3)])
    if draw.odd(0.15):
        found[0] = draw.pick([(0, 1), (-1, 0), (99, 0), (0, 3)])
    return found


def places(draw: Draw) -> Any:
    found = draw.rng.uniform(0, 60, (3 * COUNT, 2))
    return found[:-1] if draw.odd(0.1) else found


def photographs(draw: Draw) -> Any:
    """Return two photographs of one texture at two depths, or images that share nothing."""
    if draw.odd(0.5):
        return several(image if draw.odd(0.7) else channels, 0, 3)(draw)
    near, far = (np.kron(draw.rng.random((9, 16)), np.ones((5, 5))) for _ in range(2))
    views = []
    for shift in (0, 4):
        view = np.roll(far, shift, 1)
        view[14:31, 21:57] = np.roll(near, 3 * shift, 1)[14:31, 21:57]
        views.append((255 * view).astype(draw.pick(["uint8", "float32"])))
    return views


def round_trip(points: Any, colors: Any, format: Any, images: Any) -> Any:
    """Write a reconstruction and read it again where that is possible."""
    made = cvkern.Reconstruction(
        ("a", "b"), np.stack([np.eye(3, 4)] * 2), (CAMERA,), np.zeros(2, int), points, colors,
        np.array([[0, 0], [0, 1]], np.int32), np.full((2, 2), 7.0), np.zeros(1),
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        cvkern.write_reconstruction(folder, made, format=format, images=images)
        return cvkern.read_reconstruction(folder).points if "colmap" in format else None


def first(draw: Draw) -> Any:
    """Return a texture, or any image."""
    if draw.odd(0.3):
        return (image if draw.odd(0.6) else channels)(draw)
    return (255 * np.kron(draw.rng.random((9, 14)), np.ones((5, 5)))).astype("uint8")


RANGE: dict[str, Maker] = {"data_range": maybe(number(0.5, 300))}
CALLS: dict[str, Call] = {
    "recognize_panoramas": Call(cvkern.recognize_panoramas, {"images": heap}, RANGE),
    "match_photographs": Call(
        cvkern.match_photographs,
        {"image0": first, "image1": first},
        {
            **RANGE,
            "threshold": number(0.1, 20),
            "max_keypoints": whole(0, 90),
            "max_ratio": number(0.5, 1.1),
            "seed": whole(-1, 9),
        },
    ),
    "stitch": Call(
        cvkern.stitch,
        {"images": heap},
        {
            **RANGE,
            "surface": one("auto", "plane", "cylinder", "sphere", "none"),
            "scale": number(0.2, 2),
            "crop": one(False, True),
            "compensate": one(True, False),
            "bands": maybe(one(1, 3, 8, 0)),
            "focal_lengths": maybe(one(100, (100, 120), (0, 1))),
            "max_pixels": one(10**5, 99, 0),
            "names": maybe(one(["a", "b"], "ab", [3])),
        },
    ),
    "adjust_bundle": Call(
        cvkern.adjust_bundle,
        {
            "poses": poses,
            "lenses": one(CAMERA, [CAMERA, CAMERA], []),
            "points": points,
            "tracks": tracks,
            "places": places,
        },
        {
            "lens_of": one(np.zeros(3, int), [0, 1, 0], [0.5, 0, 0]),
            "fixed": one(np.array([True, False, True]), np.zeros(3, bool), [1, 0, 0]),
            "refine": one("none", "focal", "distortion", "all", "some"),
            "loss": one("huber", "squared", "cauchy", "l1"),
            "scale": number(0.1, 20),
            "max_steps": whole(0, 6),
        },
    ),
    "reconstruct": Call(
        cvkern.reconstruct,
        {"images": photographs},
        {
            "focal_lengths": maybe(one(90, (90, 110), (0, 1))),
            "lens": one("shared", "own", "both"),
            "refine": one(False, True),
            "max_keypoints": whole(1, 300),
            "data_range": maybe(number(0.5, 300)),
            "seed": whole(0, 9),
        },
    ),
    "write_reconstruction": Call(
        round_trip,
        {
            "points": lambda draw: draw.rng.normal(size=(1, 3)),
            "colors": lambda draw: draw.rng.integers(0, 256, (1, 3)).astype(np.uint8),
            "format": one("colmap", "colmap_binary", "transforms", "ply", "xml"),
            "images": one("", "images"),
        },
        {},
    ),
    "read_reconstruction": Call(cvkern.read_reconstruction, {"path": one(5, None)}, {}),
}
