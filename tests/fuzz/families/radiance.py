"""Radiance fields: the cheap functions, such as cameras, rays and scores."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern import radiance
from tests.fuzz.arguments import Call, Draw, Maker, image, number, one, rows, whole


def poses(draw: Draw) -> Any:
    """Return poses of cameras, or sometimes other arrays."""
    count = int(draw.pick([1, 2, 5]))
    found = radiance.look_at(draw.rng.normal(0, 1, (count, 3)) + np.array([4, 0, 1]), np.zeros(3))
    return found if draw.odd(0.9) else draw.rng.normal(size=(count, 3, 4))


def views(draw: Draw) -> radiance.Cameras:
    """Return cameras, with a lens or without."""
    count = int(draw.pick([1, 2, 5]))
    stands = radiance.look_at(draw.rng.normal(0, 1, (count, 3)) + np.array([4, 0, 1]), np.zeros(3))
    bent = draw.rng.normal(0, 0.3, 5) if draw.odd(0.5) else 0.0
    return radiance.cameras(stands, [30, 30, 16, 12], 33, 25, distortion=bent)


def points(draw: Draw) -> Any:
    """Return points of space."""
    count = int(draw.pick([0, 1, 7, 40]))
    found = draw.rng.normal(0, 1, (count, 3)) * draw.pick([1, 1, 1e-30, 1e30])
    if draw.odd(0.1) and count:
        found[0, 0] = draw.pick([np.nan, np.inf, -np.inf])
    return found.astype(draw.pick(["f4", "f8"]))


def samples(draw: Draw, columns: int | None) -> Any:
    """Return numbers along rays, forty of them."""
    shape = (40,) if columns is None else (40, columns)
    found = draw.rng.random(shape) * draw.pick([1, 1, 50, 0])
    if draw.odd(0.05):
        found.reshape(-1)[3] = draw.pick([np.nan, np.inf, -1])
    return found.astype(np.float32)


def spans(draw: Draw) -> Any:
    """Return the first sample of each ray, and the number of its samples."""
    right = np.array([[0, 5], [5, 0], [5, 20], [25, 15]], np.int32)
    return right if draw.odd(0.8) else draw.rng.integers(-2, 50, (4, 2)).astype(np.int32)


def composite_backward(**given: Any) -> Any:
    """Call the gradient with a gradient that fits the rays."""
    spans = given["spans"]
    count = len(spans) if getattr(spans, "ndim", 0) == 2 else 4
    full = radiance.Composite(
        np.ones((count, 3), np.float32), np.ones(count, np.float32), None, None
    )
    return radiance.composite_rays_backward(full, **given)


RAYS: dict[str, Maker] = {
    "density": lambda draw: samples(draw, None),
    "color": lambda draw: samples(draw, 3),
    "distances": lambda draw: np.abs(samples(draw, 2)),
    "spans": spans,
}
PICTURES: dict[str, Maker] = {"image": image, "truth": image}
CALLS: dict[str, Call] = {
    "radiance.look_at": Call(
        radiance.look_at,
        {"eyes": rows(3), "targets": one([0, 0, 0], [[1, 2, 3]], [1e300, 0, 0])},
        {"up": one((0, 0, 1), (0, 0, 0), (1e-200, 0, 0))},
    ),
    "radiance.cameras": Call(
        radiance.cameras,
        {
            "poses": poses,
            "intrinsics": one([30, 30, 16, 12], [[30, 30, 16, 12]], [0, 1, 2, 3]),
            "width": whole(1, 99),
            "height": whole(1, 99),
        },
        {"distortion": one(0.0, [0.1, 0, 0, 0, 0], [np.nan] * 5)},
    ),
    "radiance.pixel_rays": Call(
        radiance.pixel_rays, {"cameras": views, "view": whole(0, 2), "pixels": rows(2)}, {}
    ),
    "radiance.project": Call(
        radiance.project, {"cameras": views, "view": whole(0, 2), "points": points}, {}
    ),
    "radiance.orbit_cameras": Call(
        radiance.orbit_cameras, {"views": views}, {"frames": whole(1, 9), "factor": number(0.5, 2)}
    ),
    "radiance.psnr": Call(radiance.psnr, PICTURES, {"data_range": number(0.1, 300)}),
    "radiance.ssim": Call(radiance.ssim, PICTURES, {"data_range": number(0.1, 300)}),
    "radiance.positional_encoding": Call(
        radiance.positional_encoding,
        {"points": points},
        {"frequencies": whole(1, 32), "include_input": one(True, False)},
        equal=False,
    ),
    "radiance.spherical_harmonics": Call(
        radiance.spherical_harmonics, {"directions": points}, {"degree": whole(0, 3)}, equal=False
    ),
    "radiance.composite_rays": Call(
        radiance.composite_rays, RAYS, {"stop": number(0, 1)}, equal=False
    ),
    "radiance.composite_rays_backward": Call(
        composite_backward, RAYS, {"stop": number(0, 1)}, equal=False
    ),
}
