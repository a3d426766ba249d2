"""Verification of hypotheses: evidence of patches, and which objects explain it best."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.recognition import MOST_HYPOTHESES, Frame, Patches, Space

STEPS = (4, 2)  # pixels of the model that a mode climbs by


class Judge(NamedTuple):
    """What evidence is weighed with, for kernels."""

    rt: Runtime
    patches: Patches
    weights: Any
    """Evidence of each word in each cell of the frame, (K, cells) int32."""
    space: Space
    frame: Frame


def weigh(judge: Judge, modes: Any) -> Any:
    """Return the evidence for each of T modes (T, 4), for kernels; modes of density 0 have none."""
    rt = judge.rt
    evidence = rt.scratch("recognition.evidence", (modes.shape[0],), np.int32)
    rt.recognition.hypotheses.weigh_evidence(*judge[1:], modes, evidence)
    return evidence


def climb(judge: Judge, modes: Any, evidence: Any, least: int) -> tuple[Any, Any]:
    """Move modes to where there is more evidence; return them and their evidence, for kernels.

    A mode goes to the best of itself and its eight neighbours, first in large steps, then in small
    ones. Modes with evidence below `least`, and all but the first of those that meet, get
    density 0.
    """
    rt = judge.rt
    count = modes.shape[0]
    nowhere = rt.scratch("recognition.nowhere", (0, 4), np.int32)
    for step in STEPS:
        moved, single = (
            rt.scratch(f"recognition.{name}{step}", (count, 4), np.int32)
            for name in ("moved", "single")
        )
        found = rt.scratch(f"recognition.found{step}", (count,), np.int32)
        rt.recognition.hypotheses.climb_modes(
            *judge[1:], step, least, modes, evidence, moved, found
        )
        rt.recognition.votes.single_modes(moved, nowhere, 0, single)
        modes, evidence = single, found
    return modes, evidence


def explain(judge: Judge, modes: Any, evidence: Any, starts: Any, least: int, found: Any) -> None:
    """Choose hypotheses by minimum description length.

    Each hypothesis saves its evidence. A patch is explained once: a hypothesis loses the evidence
    of the patches in the boxes of those that are chosen before. The one with most remaining
    evidence is chosen next, while it has at least `least`; the first wins a tie. `found`
    (MOST_HYPOTHESES + 1, 4) has their number and the last of `starts` in its first row.
    """
    rt = judge.rt
    most = MOST_HYPOTHESES
    ranked = rt.scratch("recognition.ranked", (most, 4), np.int32)
    savings = rt.scratch("recognition.savings", (most,), np.int32)
    shared = rt.scratch("recognition.shared", (most, most), np.int32)
    kernels = rt.recognition.hypotheses
    kernels.rank_modes(modes, evidence, least, ranked, savings)
    kernels.weigh_overlaps(*judge[1:], ranked, shared)
    kernels.explain_modes(ranked, savings, shared, starts, least, found)
