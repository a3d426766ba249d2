"""Laser lines in a frame."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Shape, Work

SIGMA, HEIGHT, NOISE = 2.0, 200.0, 4.0
THRESHOLD = 40.0  # a fifth of the line's height; a given threshold needs no look at the strengths
# Steger's rule leaves half of the bound s sqrt(2 sigma / sqrt(pi)) / A of a column alone, 0.015
# pixels; the largest of 4000 columns is at four times that, and a slant adds a little.
LIMIT = 0.08
# Columns at either end, where the smoothing repeats the last one: a slanted line has a kink.
ENDS = 8


def _rows(width: int, height: int) -> np.ndarray:
    """Return the row of the line in each column."""
    x = np.arange(width)
    return 0.5 * height + 0.1 * height * np.sin(3 * x / width) + 0.03 * x


def _frame(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    away = np.arange(shape[0])[:, None] - _rows(shape[1], shape[0])
    seen = 20 + HEIGHT * np.exp(-(away**2) / (2 * SIGMA**2)) + rng.normal(0, NOISE, shape)
    return seen.round().clip(0, 255).astype(np.uint8)


def _detect(frame: Any) -> Any:
    return cvkern.detect_laser_lines(frame, sigma=SIGMA, threshold=THRESHOLD).positions


def _farthest(ours: tuple[np.ndarray, ...], right: tuple[np.ndarray, ...]) -> float:
    return float(np.abs(ours[0] - right[0])[ENDS:-ENDS].max())


CASES = (
    Case(
        name="detect_laser_lines",
        title="Laser line by Steger's rule, uint8",
        image=_frame,
        call=_detect,
        oracle=lambda frame: _rows(frame.shape[1], frame.shape[0]),
        oracle_name="the line that was rendered",
        difference=_farthest,
        tolerance=LIMIT,
        bytes_per_pixel=1,
        operations_per_pixel=6,
        work=Work("pixels", lambda frame: frame.size),
        margin=0,
    ),
)
