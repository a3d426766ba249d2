"""The search of a picture for objects: patches, votes, modes, evidence, description."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import check_number
from cvkern._runtime import runtime
from cvkern.kernels.codes.recognition import Occurrences
from cvkern.recognition._arguments import check_picture, check_scales
from cvkern.recognition._kept import kept
from cvkern.recognition.figures import Found, inside
from cvkern.recognition.fitting import Fitted, frame_on
from cvkern.recognition.hypotheses import climb, explain, weigh
from cvkern.recognition.patches import sample
from cvkern.recognition.training import UNIT, Settings
from cvkern.recognition.votes import activate, factors_at, find_modes, layout

HOPE = 6  # evidence below the threshold from which on a mode climbs


def search(
    image: Any,
    scales: Any,
    threshold: float | None,
    data_range: float | None,
    settings: Settings,
    fitted: Fitted,
) -> Found:
    """Return what is found in a picture, for kernels."""
    image, white = check_picture(image, "image", data_range)
    sizes = check_scales(scales)
    least = fitted.threshold if threshold is None else check_number(threshold, "threshold")
    rt = runtime(image)
    shape = tuple(image.shape[:2])
    nothing = Found(rt, shape, np.empty((0, 4), np.int32), np.empty(0), None)
    sampled = sample(rt, image, white, settings.sizes(sizes), settings.sampling)
    if not len(sampled.places):
        return nothing
    patches = activate(rt, sampled, fitted.words, settings.least, settings.most)
    occurrences = Occurrences(kept(rt, fitted.starts), kept(rt, fitted.entries))
    votes, modes = find_modes(rt, patches, occurrences, shape, sizes)
    modes = modes[inside(modes, np.array(shape), settings)]
    if not len(modes):
        return nothing._replace(votes=votes)
    weights, space = kept(rt, fitted.weights), votes.space
    frame = frame_on(rt, settings)
    floor = int(np.ceil(np.clip(least * UNIT, -(2**30), 2**30))) - fitted.bias
    evidence = weigh(rt, patches, weights, space, frame, modes)
    promising = evidence >= floor - HOPE * UNIT
    modes, evidence = modes[promising], evidence[promising]
    factors = factors_at(layout((shape[0], shape[1]), sizes)[0], modes[:, 2])
    modes, evidence = climb(rt, patches, weights, space, frame, modes, factors, evidence)
    chosen, left = explain(rt, patches, weights, space, frame, modes, evidence, floor)
    return Found(rt, shape, modes[chosen], (left + fitted.bias) / UNIT, votes)


def votes_of(found: Found, scales: Any) -> list[np.ndarray]:
    """Return the sums of the cells of each scale, on the host."""
    bins, _, _ = layout((found.shape[0], found.shape[1]), check_scales(scales))
    if found.votes is None:
        return [np.zeros((rows, columns), np.int32) for _, rows, columns, _, _ in bins[0]]
    sums = np.array(found.rt.to_numpy(found.votes.sums))
    ends = np.cumsum([rows * columns for _, rows, columns, _, _ in bins[0]])
    parts = np.split(sums, ends[:-1])
    return [part.reshape(b[1], b[2]) for part, b in zip(parts, bins[0], strict=True)]
