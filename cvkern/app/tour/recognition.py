"""Recognition: visual words vote for objects, and their masks are put together."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import cvkern
from cvkern.app.commands.recognize import drawn
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.images.colors import apply_colormap

FIGURE = np.array([255, 98, 41])
SPLIT = 192  # column between the coins to learn from and those to find
SCALES = (0.71, 0.84, 1.0, 1.19, 1.41, 1.68)
SHOWN = 96  # words that are shown
THRESHOLD = 6.0  # least score of a coin


def chapter() -> Chapter:
    """Return the chapter on recognition."""
    return Chapter(
        "recognition",
        "Recognition",
        "Patches of an object vote for where its middle is. A model learns from the coins in the "
        "left half of a photograph, and from pictures without coins; it then finds the coins in "
        "the right half.",
        (_votes, _objects),
    )


@cache
def _learnt() -> tuple[cvkern.ShapeModel, np.ndarray]:
    """Return a model of coins, and the part of the photograph that it has not seen."""
    from skimage import data

    photo = data.coins()
    disks = cvkern.detect_circles(photo, (15, 35))
    y, x = np.indices(photo.shape)
    boxes, mask = [], np.zeros(photo.shape, bool)
    for (row, column), radius in zip(disks.centers, disks.radii, strict=True):
        box = [row - radius - 2, column - radius - 2, row + radius + 3, column + radius + 3]
        if box[3] < SPLIT:
            boxes.append(box)
            mask |= np.hypot(y - row, x - column) <= radius
    model = cvkern.ShapeModel(200, patch=12, size=40, layers=1)
    others = [data.camera()[::2, ::2], data.page()[:, :200], data.brick()[:200, :250]]
    model.fit([photo[:, :SPLIT]], [boxes], [mask[:, :SPLIT]], others)
    return model, photo[:, SPLIT:]


def _votes(clock: Clock) -> Figure:
    model, photo = _learnt()
    votes: Any = clock(model.votes, photo, scales=SCALES)
    words = model.words
    assert words is not None
    tiles = np.pad(128 + words[:SHOWN].astype(np.int16), ((0, 0), (1, 1), (1, 1)))
    side = tiles.shape[1]
    sheet = tiles.reshape(8, -1, side, side).transpose(0, 2, 1, 3).reshape(8 * side, -1)
    own = votes[SCALES.index(1.19)]
    return Figure(
        "Visual words, and their votes",
        f"The patches of {SPLIT} columns of the photograph were clustered to {len(words)} words. "
        "In the other half, each patch votes by its words for the middles of coins; here the votes "
        "for coins 1.19 times as large as those of the model.",
        "votes = model.votes(photo, scales=scales)",
        (
            Panel("recognition-words", sheet.astype(np.uint8), f"{SHOWN} of the words"),
            Panel(
                "recognition-votes",
                np.kron(apply_colormap(own, vmin=0), np.ones((4, 4, 1), np.uint8)),
                "Votes for middles of coins",
            ),
        ),
        clock.take(),
    )


def _objects(clock: Clock) -> Figure:
    model, photo = _learnt()
    found: Any = clock(model.segment, photo, scales=SCALES, threshold=THRESHOLD)
    figure = np.repeat(photo[..., None], 3, axis=2)
    inside = found.masks.any(axis=0)
    figure[inside] = (0.55 * figure[inside] + 0.45 * FIGURE).astype(np.uint8)
    return Figure(
        "Objects, and their pixels",
        f"Where votes gather, the words in the box are weighed: {len(found.masks)} boxes remain "
        "after each patch is explained once. The votes for a coin are followed back to their "
        "patches, which know from training what is coin and what is ground.",
        "found = model.segment(photo, scales=scales, threshold=6)",
        (
            Panel("recognition-boxes", drawn(photo, found.objects), "What was found"),
            Panel("recognition-masks", figure, "The pixels of the coins"),
        ),
        clock.take(),
    )
