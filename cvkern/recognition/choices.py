"""The choice among hypotheses: which objects explain the patches best."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern.kernels.codes.recognition import MOST_HYPOTHESES
from cvkern.recognition.hypotheses import Judge


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
    kernels = rt.recognition.choices
    kernels.rank_modes(modes, evidence, least, ranked, savings)
    rt.recognition.hypotheses.weigh_overlaps(*judge[1:], ranked, shared)
    kernels.explain_modes(ranked, savings, shared, starts, least, found)
