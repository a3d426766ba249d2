"""Verification of hypotheses by the evidence of patches."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.recognition import Frame, Patches, Space

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
        rt.recognition.modes.single_modes(moved, nowhere, 0, single)
        modes, evidence = single, found
    return modes, evidence
