"""What lies behind the scene of photographs without opacity."""

from __future__ import annotations

import warnings

import numpy as np

from cvkern.radiance.scenes.photographs import Scene

ALIKE, UNIFORM = 6, 0.95  # grey levels, and share of the borders, for a background of one colour


def seen_behind(scene: Scene) -> str:
    """Return the background that suits the photographs, and warn if it is not 'random'."""
    if scene.images.shape[3] == 4:
        return "random"
    views = scene.images[~scene.test]
    sides = views[:, 0], views[:, -1], views[:, :, 0], views[:, :, -1]
    borders = np.concatenate(sides, axis=1)
    color = np.median(borders, axis=(0, 1))
    same = (np.abs(borders - color) <= ALIKE).all(axis=2).mean()
    if same < UNIFORM:
        return "random"
    white, black = (color >= 255 - ALIKE).all(), (color <= ALIKE).all()
    chosen = "white" if white else "black" if black else "learnt"
    warnings.warn(
        f"background is {chosen!r}, because {same:.0%} of the photographs' borders have one "
        f"colour, {tuple(color.astype(int).tolist())}: choose another by background=",
        stacklevel=4,
    )
    return chosen
