"""From photographs of patterns to the projector's coordinates."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Shape, Work, relative, unequal

FREQUENCIES, STEPS = (1, 8, 64), 4
NOISE = 2.0  # standard deviation of a photograph's, in its values
# A phase is off by 2e-7 in the arc tangent and some roundings of 2^-24; of 64 fringes it is a share
# of the whole axis.
PLACE = 1e-6


def _gray(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Photograph the patterns of a projector that is as large as the image, columns alone."""
    seen = cvkern.gray_code_patterns(shape, axes=["columns"]) * np.float32(0.7)
    return (20 + seen + rng.normal(0, NOISE, seen.shape)).clip(0, 255).astype(np.uint8)


def _columns(frames: np.ndarray) -> np.ndarray:
    bits = np.cumsum(frames[0::2] > frames[1::2], axis=0) % 2
    return np.tensordot(2 ** np.arange(len(bits) - 1, -1, -1), bits, 1).astype(np.int32)


def _decode(frames: Any) -> Any:
    shape = tuple(frames.shape[1:])
    return cvkern.decode_gray_code(frames, shape, axes=["columns"], margin=5).columns


def _fringes(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    seen = cvkern.phase_shift_patterns(shape, FREQUENCIES, STEPS, axes=["columns"])
    noisy = 20 + seen * np.float32(0.7) + rng.normal(0, NOISE, seen.shape)
    return noisy.clip(0, 255).astype(np.uint8)


def _places(frames: np.ndarray) -> np.ndarray:
    place = np.zeros(frames.shape[1:])
    for j, f in enumerate(FREQUENCIES):
        turns = 2 * math.pi * np.arange(STEPS) / STEPS
        own = frames[j * STEPS : (j + 1) * STEPS].astype(np.float64)
        s, c = np.tensordot(np.sin(turns), own, 1), np.tensordot(np.cos(turns), own, 1)
        p = np.arctan2(s, c) / (2 * math.pi)
        k = np.where(p < 0, 1, 0) if j == 0 else np.floor(f * place - p + 0.5)
        place = (p + k) / f
    return (place - np.floor(place)) * frames.shape[2] - 0.5


def _decode_phase(frames: Any) -> Any:
    return cvkern.decode_phase_shift(
        frames, tuple(frames.shape[1:]), FREQUENCIES, STEPS, axes=["columns"], threshold=10
    ).columns


CASES = (
    Case(
        name="decode_gray_code",
        title="Gray code of the columns, uint8",
        image=_gray,
        call=_decode,
        oracle=_columns,
        oracle_name="NumPy",
        difference=unequal,
        tolerance=0.0,
        bytes_per_pixel=2 * 11 + 5,
        operations_per_pixel=11 * 6,
        work=Work("pixels", lambda frames: frames.shape[1] * frames.shape[2]),
        sizes=("1080p",),
        margin=0,
    ),
    Case(
        name="decode_phase_shift",
        title="Columns of three fringes in four steps, uint8",
        image=_fringes,
        call=_decode_phase,
        oracle=_places,
        oracle_name="NumPy in float64",
        difference=relative,
        tolerance=PLACE,
        bytes_per_pixel=12 + 13,
        operations_per_pixel=12 * 4 + 3 * 40,
        work=Work("pixels", lambda frames: frames.shape[1] * frames.shape[2]),
        sizes=("1080p",),
        margin=0,
    ),
)
