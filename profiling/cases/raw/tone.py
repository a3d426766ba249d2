"""From radiance to a screen, and from exposures to one picture."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Peer, Shape, Work, relative
from tests.raw import reference_pyramids as reference

CONTRAST = 5.0
SIGMA = math.log2(2.5)


def _radiance(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Return fields of light, ten stops apart, with texture."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    stops = 4 * np.sign(np.sin(x / 61)) * np.sign(np.cos(y / 47)) + np.sin((x + y) / 200)
    return (2.0 ** (stops + rng.normal(0, 0.1, shape))).astype(np.float32)


def _layered(radiance: np.ndarray) -> np.ndarray:
    """Shrink edges of the logarithm, and take what 0.5 % of the pixels exceed for white."""
    logs = np.log2(radiance.astype(np.float64))
    span = np.ptp(logs)
    count = min(math.ceil(span / SIGMA) + 1, 64)
    levels = 1 + int(math.log2(min(logs.shape)))
    slope = min(1.0, math.log2(CONTRAST) / span)
    found = reference.fast_local_laplacian(logs, levels, SIGMA, slope, count)
    step = max(1, math.ceil(math.sqrt(logs.size / 2**16)))
    values = np.sort(found[::step, ::step], axis=None)
    white = values[min(int(0.995 * values.size), values.size - 1)]
    return np.minimum(2 ** (found - white), 1)


def _frames(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    light = _radiance(shape, rng)[..., None] * np.array([1.0, 0.8, 0.6])
    frames = [255 * np.clip(light * t, 0, 1) ** 0.45 for t in (0.06, 0.5, 4)]
    return np.stack(frames).astype(np.uint8)


def _mertens(cv2: Any, frames: np.ndarray) -> np.ndarray:
    return cv2.createMergeMertens().process(list(frames))


CASES = (
    Case(
        name="local_laplacian",
        title="Local Laplacian tone mapping, float32",
        image=_radiance,
        call=lambda radiance: cvkern.tone_map(radiance, "local_laplacian", contrast=CONTRAST),
        oracle=_layered,
        oracle_name="NumPy in float64",
        difference=relative,
        tolerance=2e-5,  # logarithms of 10 stops have a rounding of 1e-6 in each of some ten sums
        bytes_per_pixel=8,
        operations_per_pixel=150,
        captures=False,
        work=Work("pixels", lambda radiance: radiance.size),
        sizes=("1080p",),
        margin=0,
    ),
    Case(
        name="fuse_exposures",
        title="Fusion of three exposures in colour, uint8",
        image=_frames,
        call=cvkern.fuse_exposures,
        oracle=lambda frames: reference.fused(frames / 255, 1, 1, 1),
        oracle_name="NumPy in float64",
        difference=relative,
        tolerance=1e-5,  # weights are quotients of small products in float32
        bytes_per_pixel=9 + 12,
        operations_per_pixel=3 * 80,
        peers=(Peer("OpenCV", "cv2", _mertens, note="leaves 0 to 1"),),
        work=Work("pixels", lambda frames: frames[0].size // 3),
        sizes=("1080p",),
        margin=0,
    ),
)
