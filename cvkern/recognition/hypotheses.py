"""Verification of hypotheses: evidence of patches, and which objects explain it best."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.recognition import FACTOR_BITS, FINE, Frame, Patches, Space
from cvkern.recognition.votes import distinct

STEPS = (4, 2)  # pixels of the model that a mode climbs by
AROUND = np.array([(y, x) for y in (0, -1, 1) for x in (0, -1, 1)])
MOST_HYPOTHESES = 256  # hypotheses above the threshold that are compared with each other


def weigh(
    rt: Runtime, patches: Patches, weights: Any, space: Space, frame: Frame, modes: np.ndarray
) -> np.ndarray:
    """Return the evidence for each of T modes (T, 4), on the host."""
    evidence = rt.scratch("recognition.evidence", (len(modes),), np.int32)
    sent = rt.send("recognition.hypotheses", modes)
    rt.recognition.hypotheses.weigh_evidence(patches, weights, space, frame, sent, evidence)
    return np.array(rt.to_numpy(evidence))


def climb(
    rt: Runtime,
    patches: Patches,
    weights: Any,
    space: Space,
    frame: Frame,
    modes: np.ndarray,
    factors: np.ndarray,
    evidence: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Move modes to where there is more evidence; return all that remain, and their evidence.

    A mode goes to the best of itself and its eight neighbours, first in large steps, then in small
    ones; the first wins a tie. `factors` are the sizes of the modes in parts of 2^16. Modes that
    meet are one.
    """
    factors = factors.astype(np.int64)
    for step in STEPS if len(modes) else ():
        apart = (FINE * step * factors + (1 << (FACTOR_BITS - 1))) >> FACTOR_BITS
        near = np.repeat(modes[:, None], len(AROUND), axis=1)
        near[:, :, :2] += (AROUND * apart[:, None, None]).astype(np.int32)
        found = weigh(rt, patches, weights, space, frame, near.reshape(-1, 4))
        best = found.reshape(len(modes), -1).argmax(axis=1)
        every = np.arange(len(modes))
        modes, evidence = near[every, best], found.reshape(len(modes), -1)[every, best]
        first = distinct(modes)
        modes, evidence, factors = modes[first], evidence[first], factors[first]
    return np.ascontiguousarray(modes), evidence


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
    # What is chosen falls below `least` and does not rise again, so each is chosen once at most.
    while left.max() >= least:
        best = int(left.argmax())
        chosen.append(best)
        saved.append(int(left[best]))
        left -= loss[:, best]
        left[best] = least - 1
    return order[chosen], np.array(saved)
