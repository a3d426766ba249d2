"""What lies behind the scene of photographs without opacity."""

from __future__ import annotations

import numpy as np

from cvkern._notices import warn
from cvkern.radiance.scenes.photographs import Scene

ALIKE, UNIFORM = 6, 0.95  # grey levels, and share of the borders, for a background of one colour


def seen_behind(scene: Scene) -> str:
    """Return the background that suits the photographs, and warn if it is not 'random'."""
    if scene.images.shape[3] == 4:
        return "random"
    borders = _borders(scene)
    color = np.median(borders, axis=(0, 1))
    same = (np.abs(borders - color) <= ALIKE).all(axis=2).mean()
    if same < UNIFORM:
        return "random"
    white, black = (color >= 255 - ALIKE).all(), (color <= ALIKE).all()
    chosen = "white" if white else "black" if black else "learnt"
    warn(
        f"background is {chosen!r}, because {same:.0%} of the photographs' borders have one "
        f"colour, {tuple(color.astype(int).tolist())}: choose another by background="
    )
    return chosen


def color_behind(scene: Scene, background: str) -> np.ndarray:
    """Return the colour of a background at the beginning of a training, (3,) float32."""
    if background == "learnt" and scene.images.shape[3] == 3:
        return np.asarray(np.median(_borders(scene), axis=(0, 1)) / 255, np.float32)
    return np.full(3, {"black": 0.0, "learnt": 0.5}.get(background, 1.0), np.float32)


def _borders(scene: Scene) -> np.ndarray:
    """Return the border pixels of the photographs that are trained on, (N, P, 3)."""
    views = scene.images[~scene.test]
    sides = views[:, 0], views[:, -1], views[:, :, 0], views[:, :, -1]
    return np.concatenate(sides, axis=1)
