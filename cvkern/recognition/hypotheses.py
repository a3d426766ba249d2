"""Verification of hypotheses: evidence of patches, and which objects explain it best."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.recognition import Frame, Patches, Space

MOST_HYPOTHESES = 256  # hypotheses above the threshold that are compared with each other


def weigh(
    rt: Runtime, patches: Patches, weights: Any, space: Space, frame: Frame, modes: np.ndarray
) -> np.ndarray:
    """Return the evidence for each of T modes (T, 4), on the host."""
    evidence = rt.scratch("recognition.evidence", (len(modes),), np.int32)
    sent = rt.send("recognition.hypotheses", modes)
    rt.recognition.hypotheses.weigh_evidence(patches, weights, space, frame, sent, evidence)
    return np.array(rt.to_numpy(evidence))


def explain(
    rt: Runtime,
    patches: Patches,
    weights: Any,
    space: Space,
    frame: Frame,
    modes: np.ndarray,
    evidence: np.ndarray,
    least: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Choose hypotheses by minimum description length; return indices and remaining evidence.

    Each hypothesis saves its evidence. A patch is explained once: a hypothesis loses the evidence
    of the patches in the boxes of those that are chosen before. The one with most remaining
    evidence is chosen next, while it has at least `least`; the first wins a tie.
    """
    order = np.argsort(-evidence.astype(np.int64), kind="stable")
    order = order[evidence[order] >= least][:MOST_HYPOTHESES]
    if not len(order):
        return order, evidence[order]
    sent = rt.send("recognition.candidates", np.ascontiguousarray(modes[order]))
    shared = rt.scratch("recognition.shared", (len(order), len(order)), np.int32)
    rt.recognition.hypotheses.weigh_overlaps(patches, weights, space, frame, sent, shared)
    loss = np.maximum(rt.to_numpy(shared), 0).astype(np.int64)
    left = evidence[order].astype(np.int64)
    chosen, saved = [], []
    while left.max() >= least:
        best = int(left.argmax())
        chosen.append(best)
        saved.append(int(left[best]))
        left -= loss[:, best]
        left[best] = least - 1
    return order[chosen], np.array(saved)
