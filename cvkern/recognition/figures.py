"""What was found in a picture: boxes, and figures that follow votes back to masks of training."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.recognition import FINE, OCTAVE
from cvkern.recognition._kept import kept
from cvkern.recognition.fitting import frame_on
from cvkern.recognition.training import Settings
from cvkern.recognition.votes import Votes

OVERHANG = 0.1  # part of the sides of a box that may stick out of the picture


class Objects(NamedTuple):
    """Objects that a model found, the strongest first."""

    boxes: Any
    """First row and column, and those behind the last, (N, 4) float32."""
    scores: Any
    """Logarithm of the odds that there is an object, (N,) float32."""
    centers: Any
    """Row and column of the middle, (N, 2) float32."""
    scales: Any
    """Size, in sizes of the model, (N,) float32."""


class Segmentation(NamedTuple):
    """Objects that a model found, and their pixels."""

    objects: Objects
    masks: Any
    """Pixels of each object, (N, H, W) bool."""


class Found(NamedTuple):
    """What a search found in a picture."""

    rt: Runtime
    shape: tuple[int, ...]
    modes: np.ndarray
    """Row, column, scale and density of each object, (N, 4) int32."""
    scores: np.ndarray
    votes: Votes | None
    """Votes of the picture; None if there are none."""


def paint(found: Found, figures: np.ndarray, settings: Settings, masks: Any) -> None:
    """Fill the masks (N, H, W), for kernels, of what was found."""
    rt, side = found.rt, settings.sampling.side
    if found.votes is None:
        return
    patches, occurrences, space, window, _ = found.votes
    shape = (len(found.modes), settings.height + 2 * side, settings.width + 2 * side)
    balance = rt.scratch("recognition.balance", shape, np.int32)
    modes = rt.send("recognition.found", np.ascontiguousarray(found.modes))
    kernels = rt.recognition.figures
    kernels.paint_figures(
        patches, occurrences, space, window, frame_on(rt, settings),
        kept(rt, figures), modes, balance,
    )  # fmt: skip
    kernels.spread_figures(balance, modes, space, masks)


def inside(modes: np.ndarray, shape: np.ndarray, settings: Settings) -> np.ndarray:
    """Return which boxes lie within the picture, but for `OVERHANG` of their sides."""
    half = 2.0 ** (modes[:, 2:3] / OCTAVE) * np.array([settings.height, settings.width]) / 2
    low = (1 - 2 * OVERHANG) * half - 0.5
    within = (modes[:, :2] / FINE >= low) & (modes[:, :2] / FINE <= shape - 1 - low)
    return np.flatnonzero(within.all(axis=1))


def objects_of(found: Found, settings: Settings) -> Objects:
    """Return what was found, in pixels."""
    centers = found.modes[:, :2] / FINE
    scales = 2.0 ** (found.modes[:, 2] / OCTAVE)
    half = scales[:, None] * np.array([settings.height, settings.width]) / 2
    boxes = np.concatenate([centers + 0.5 - half, centers + 0.5 + half], axis=1)
    result = (boxes, found.scores, centers, scales)
    return Objects(*(found.rt.give(np.ascontiguousarray(a, np.float32)) for a in result))
