"""From exposures of a scene to its radiance, and to one picture."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Peer, Shape, Work, relative

SECONDS = (0.25, 1.0, 4.0)
CURVE = np.log2(((np.arange(256) + 0.5) / 128) ** 2.2)[:, None].repeat(3, axis=1)


def _exposures(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    light = 2.0 ** rng.uniform(-6, 1, (*shape, 3))
    values = [255 * np.minimum(light * t, 1) ** (1 / 2.2) for t in SECONDS]
    return np.array(values).astype(np.uint8)


def _merged(images: np.ndarray) -> np.ndarray:
    """Take the weighted mean of what each exposure says, in float64."""
    codes = np.arange(256)
    centre = (np.minimum(codes, 255 - codes) - 3).clip(0) / 124
    weight = centre * np.clip(8 * centre, 0, 1) ** 2 / np.gradient(CURVE[:, 0]) ** 2
    w = weight[images]
    light = CURVE[:, 0][images] - np.log2(np.array(SECONDS))[:, None, None, None]
    total = w.sum(axis=0)
    darkest = CURVE[:, 0][images[2]] - np.log2(SECONDS[2])
    brightest = CURVE[:, 0][images[0]] - np.log2(SECONDS[0])
    ends = np.where(images[0] < 128, darkest, brightest)
    return 2 ** np.where(total > 0, (w * light).sum(axis=0) / np.where(total > 0, total, 1), ends)


def _opencv(cv2: Any, images: np.ndarray) -> np.ndarray:
    response = (2**CURVE).astype(np.float32)[:, None]
    return cv2.createMergeDebevec().process(list(images), np.array(SECONDS, np.float32), response)


CASES = (
    Case(
        name="merge_exposures",
        title="Radiance of three exposures in colour, uint8",
        image=_exposures,
        call=lambda images: cvkern.merge_exposures(images, SECONDS, CURVE),
        oracle=_merged,
        oracle_name="NumPy in float64",
        difference=relative,
        tolerance=1e-5,
        bytes_per_pixel=9 + 12,
        operations_per_pixel=3 * 3 * 6,
        peers=(Peer("OpenCV", "cv2", _opencv, note="with other weights"),),
        work=Work("pixels", lambda images: images[0].size // 3),
        sizes=("1080p",),
        margin=0,
    ),
)
