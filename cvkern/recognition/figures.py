"""Figures of objects: their votes are followed back to the masks of training."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.recognition.training import Settings
from cvkern.recognition.votes import Votes


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
    rt, votes, side = found.rt, found.votes, settings.sampling.side
    if votes is None:
        return
    shape = (len(found.modes), settings.height + 2 * side, settings.width + 2 * side)
    balance = rt.scratch("recognition.balance", shape, np.int32)
    modes = rt.send("recognition.found", np.ascontiguousarray(found.modes))
    kernels = rt.recognition.figures
    kernels.paint_figures(
        votes.listed, votes.sources, votes.starts, votes.space, votes.window, votes.places,
        rt.send("recognition.figures", figures), modes, balance,
    )  # fmt: skip
    kernels.spread_figures(balance, modes, votes.space, masks)
