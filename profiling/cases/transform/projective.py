"""Homographies and sizes of images."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.ndimage

import cvkern
from profiling.arrays import photograph, photograph_uint8
from profiling.case import Case, Peer, Shape, relative

TILT = np.array([[0.95, 0.08, 12.0], [-0.06, 1.03, 9.0], [2e-5, -3e-5, 1.0]])


def _color(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    gray = photograph_uint8(shape, rng)
    return np.ascontiguousarray(np.stack([gray, 255 - gray, gray // 2], axis=2))


def _seen_through(image: np.ndarray) -> np.ndarray:
    """Map in NumPy, sample with SciPy, round as said."""
    height, width = image.shape[:2]
    y, x = np.mgrid[:height, :width].astype(float)
    u = np.linalg.inv(TILT) @ np.stack((x, y, np.ones_like(x))).reshape(3, -1)
    places = np.stack((u[1] / u[2], u[0] / u[2])).reshape(2, height, width)
    # One place is the first pixel itself: the rounding of float64 must not bring it outside.
    places = np.around(places, 9)
    sample: Any = scipy.ndimage.map_coordinates
    layers = [sample(image[..., c].astype(float), places, order=1) for c in range(image.shape[2])]
    return np.floor(np.stack(layers, axis=2) + 0.5)


def _apart(ours: tuple[np.ndarray, ...], right: tuple[np.ndarray, ...]) -> float:
    """Largest difference in grey values."""
    (a,), (b,) = ours, right
    return float(np.abs(a.astype(float) - b).max()) if a.shape == b.shape else np.inf


def _waves(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a colour picture and places that bend its lines."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    places = np.stack((y + 3 * np.sin(x / 50), x + 3 * np.cos(y / 40)))
    return _color(shape, rng), places.astype(np.float32)


def _sampled(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    sample: Any = scipy.ndimage.map_coordinates
    layers = (image[..., c].astype(float) for c in range(image.shape[2]))
    return np.stack([sample(a, places, order=1, mode="nearest") for a in layers], axis=2)


def _smaller(image: np.ndarray) -> tuple[int, int]:
    return image.shape[0] * 2 // 3, image.shape[1] * 2 // 3


def _between(image: np.ndarray) -> np.ndarray:
    """Sample where the pixels of the smaller picture have their centres."""
    ratios = np.divide(image.shape, _smaller(image))[:, None, None]
    places = (np.indices(_smaller(image)) + 0.5) * ratios - 0.5
    sample: Any = scipy.ndimage.map_coordinates
    return sample(image.astype(float), places, order=1, mode="nearest")


def _half(image: np.ndarray) -> tuple[int, int]:
    return image.shape[0] // 2, image.shape[1] // 2


CASES = (
    Case(
        name="warp_perspective",
        title="Colour through a homography, linear, uint8 x 3",
        image=_color,
        call=lambda x: cvkern.warp_perspective(x, TILT, channel_axis=-1, dtype=np.uint8),
        oracle=_seen_through,
        oracle_name="scipy.ndimage.map_coordinates",
        difference=_apart,
        tolerance=1.0,
        bytes_per_pixel=6,
        operations_per_pixel=40,
        peers=(
            Peer(
                "OpenCV",
                "cv2",
                lambda m, x: m.warpPerspective(x, TILT, x.shape[1::-1]),
                note="other rounding",
            ),
        ),
    ),
    Case(
        name="remap",
        title="Colour at given places, linear, uint8 x 3",
        image=_waves,
        call=lambda x, at: cvkern.remap(x, at, mode="nearest", channel_axis=-1, dtype=np.uint8),
        oracle=_sampled,
        oracle_name="scipy.ndimage.map_coordinates",
        difference=_apart,
        tolerance=0.51,
        bytes_per_pixel=14,
        operations_per_pixel=30,
        peers=(
            Peer(
                "OpenCV",
                "cv2",
                lambda m, x, at: m.remap(
                    x, at[1], at[0], m.INTER_LINEAR, borderMode=m.BORDER_REPLICATE
                ),
                note="places to 1/32 of a pixel",
            ),
        ),
        sizes=("1080p",),
    ),
    Case(
        name="resize_linear",
        title="Two thirds of the size, linear without smoothing, float32",
        image=photograph,
        call=lambda x: cvkern.resize(x, _smaller(x), antialias=False),
        oracle=_between,
        oracle_name="scipy.ndimage.map_coordinates",
        difference=relative,
        tolerance=1e-6,
        bytes_per_pixel=6,
        operations_per_pixel=3,
        peers=(
            Peer(
                "OpenCV",
                "cv2",
                lambda m, x: m.resize(x, _smaller(x)[::-1], interpolation=m.INTER_LINEAR),
            ),
        ),
        sizes=("1080p",),
    ),
    Case(
        name="resize_area",
        title="Half the size by area, float32",
        image=photograph,
        call=lambda x: cvkern.resize(x, _half(x), method="area"),
        oracle=lambda x: x.astype(float).reshape(len(x) // 2, 2, -1, 2).mean(axis=(1, 3)),
        oracle_name="the mean by NumPy",
        difference=relative,
        tolerance=1e-6,
        bytes_per_pixel=5,
        operations_per_pixel=3,
        peers=(
            Peer(
                "OpenCV",
                "cv2",
                lambda m, x: m.resize(x, _half(x)[::-1], interpolation=m.INTER_AREA),
            ),
        ),
    ),
)
