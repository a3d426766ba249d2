"""Shading: images of surfaces, and surfaces from images."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import (
    Call,
    Draw,
    Maker,
    alike,
    disparity,
    image,
    mask,
    maybe,
    number,
    one,
    one_of,
    whole,
)


def _count(draw: Draw) -> int:
    """Return how many lamps a call has."""
    return int(alike(draw).pick([1, 3, 3, 4, 5, 6]))


def normals(draw: Draw) -> Any:
    """Return normals, some of them NaN or flat, or any array."""
    if draw.odd(0.1):
        return image(draw, (*draw.shape, 3))
    found = draw.rng.normal(0, 0.3, (*draw.shape, 3))
    found[..., 2] = draw.pick([1, 1, 1e-9])
    found[draw.rng.random(draw.shape) < 0.05] = np.nan
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def lights(draw: Draw) -> Any:
    """Return directions of lamps, or the numbers of a sky."""
    count, columns = int(_count(draw)), int(draw.pick([3, 3, 3, 3, 3, 4, 9, 2]))
    found = draw.rng.normal(0.2, 1, (count, columns))
    found[:, 2:3] = abs(found[:, 2:3])
    return found


def lamp(draw: Draw) -> Any:
    """Return one lamp."""
    lamps = [(0, 0, 1), (0.2, 0.3, 0.9), (0, 0, 0), (1, 2), draw.rng.normal(size=3)]
    return draw.pick([*lamps[:2], *lamps])


def images(draw: Draw) -> Any:
    """Return images under three or four lamps."""
    if draw.odd(0.3):
        return image(draw, (_count(draw), *draw.shape))
    y, x = np.indices(draw.shape) / 4.0
    depth = draw.rng.normal() * np.sin(x + draw.rng.normal()) * np.cos(y) + 0.03 * x * x
    lamps = draw.rng.normal(0, 0.5, (_count(draw), 3))
    lamps[:, 2] = 1
    shown = cvkern.lambertian(depth, lamps / np.linalg.norm(lamps, axis=1, keepdims=True))
    shown = shown * draw.pick([1, 255]) + draw.rng.normal(0, draw.pick([0, 0, 0.01]), shown.shape)
    return shown.astype(draw.pick(["f4", "f8"]))


def lit(draw: Draw) -> Any:
    """Return gradients by images of one to four lamps."""
    return draw.rng.normal(size=(_count(draw), *draw.shape)).astype(np.float32)


SURFACE: dict[str, Maker] = {"surface": one_of(image, normals, disparity), "lights": lights}
SHADED: dict[str, Maker] = {
    "albedo": one_of(number(0, 1), image),
    "shadows": one("attached", "cast", "none", "no"),
}
CALLS: dict[str, Call] = {
    "lambertian": Call(
        cvkern.lambertian, SURFACE, {**SHADED, "shape": maybe(lambda draw: draw.shape)}
    ),
    "lambertian_backward": Call(cvkern.lambertian_backward, {"grad": lit, **SURFACE}, SHADED),
    "normals_from_depth": Call(cvkern.normals_from_depth, {"depth": image}, {}),
    "mesh_from_depth": Call(cvkern.mesh_from_depth, {"depth": disparity}, {}),
    "integrate_normals": Call(
        cvkern.integrate_normals,
        # A hundred iterations, the default, take up to 20 s where normals are random.
        {"normals": normals, "iterations": whole(1, 20)},
        {
            "mask": maybe(mask),
            "method": one("poisson", "bilateral", "none"),
            "sharpness": number(0.5, 9),
            "tolerance": number(1e-6, 1e-2),
        },
        equal=False,
    ),
    "photometric_stereo": Call(
        cvkern.photometric_stereo,
        {"images": images, "lights": lights},
        {
            "method": one("consensus", "least_squares", "none"),
            "mask": maybe(mask),
            "saturation": maybe(number(0.5, 255)),
            "near": one(False, False, True),
        },
        equal=False,
    ),
    "estimate_lights": Call(
        cvkern.estimate_lights,
        {"images": images},
        {"mask": maybe(mask), "equal": one("lights", "albedo", "none")},
    ),
    "lights_from_sphere": Call(cvkern.lights_from_sphere, {"images": images, "mask": mask}, {}),
    "shape_from_shading": Call(
        cvkern.shape_from_shading,
        {"image": image, "light": lamp, "rounds": whole(0, 5)},
        {
            "mask": maybe(mask),
            "boundary": maybe(normals),
            "albedo": one_of(number(0, 1), image),
        },
        equal=False,
    ),
}
