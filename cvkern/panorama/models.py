"""Alignment of the images of one panorama: rotating cameras, or images of one plane."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern.geometry._matrices import nearest_rotations
from cvkern.panorama import adjustment
from cvkern.panorama.adjustment import (
    Observations,
    Planes,
    Rotations,
    adjust,
    cost,
    medians,
    observe,
    part,
    residuals,
    with_unit_determinant,
)
from cvkern.panorama.registration import Link, connected

FOCALS = np.geomspace(0.3, 30.0, 60)  # candidates for the first estimate, in longest sides
FARTHEST_FOCAL = 12.0  # longest sides; a camera with a longer focal length sees no perspective
MOST = 0.85  # share of the matches by which models are compared: the rest may be of wrong pairs
CONTRADICTED = 1.25  # largest ratio of the residual with given focal lengths to that without
HORIZON = 0.1  # least depth of a corner of an image of a plane, relative to the depth of its middle
WIDE = math.cos(math.radians(35))  # cameras that turn by more are not taken for sheets
GIVEN_SPREAD = 0.05  # standard deviation of the logarithms of given focal lengths
# A panorama is flat if affine maps explain it nearly as well as rotations do. The measured ratios
# of residuals are 0.95 to 1.02 for scanned sheets, and 1.9 or more for rotating cameras.
FLAT = 1.15
MUCH_BETTER = 0.85  # a model with more parameters is taken if it reduces the residual to this share
SMALL = 2.0  # pixels of the small images: rotations with a smaller residual are accepted
FAR_WORSE = 3.0  # rotations are rejected at this many times the residual of homographies
WORST = 5.0  # pixels of the small images: models with a larger residual are rejected
WRONG = 4.0  # a pair is wrong above this many times the median residual of all, and above WORST
EARLY = 20.0  # Huber's threshold while images are added
FEW_POINTS = 40  # matches of a pair in the adjustment while images are added
STRAIGHT = 0.1  # pixels of the small images: with a smaller residual no lens is looked for
CLEARLY_BENT = 0.8  # a lens is taken to bend lines if that reduces the cost to this share
MOST_BENT = 0.3  # largest size of k: with a larger one, corners would lie where the lens turns back
AT_ONCE = 1.6  # growth factor of the set of images between adjustments


class Alignment(NamedTuple):
    """Adjusted images of one panorama. The origin of pixels is the middle of an image."""

    model: str
    """'rotation', 'affine', 'homography', 'homography tree' or 'similarity tree'."""
    matrices: np.ndarray
    """(N, 3, 3): map directions, or a plane in pixels of one of the images, to pixels."""
    focals: np.ndarray | None
    """(N,), pixels."""
    rotations: np.ndarray | None
    """(N, 3, 3), from the world's axes to the camera's."""
    parents: np.ndarray
    """(N,): the parent of each image in the spanning tree, -1 for the central one."""
    residual: float
    """Root mean square of the best distances, in pixels of the images as compared."""
    bend: float = 0.0
    """The lens moves a pixel p to ``p (1 + bend |p|^2)``."""


def align(
    links: Sequence[Link], sides: np.ndarray, factors: np.ndarray, focals: np.ndarray | None
) -> Alignment:
    """Align images that links connect; `sides` (N, 2) are widths and heights, `focals` pixels."""
    middles, unit = (sides - 1) / 2.0, float(sides.max())
    given = None if focals is None else focals / unit
    seen = observe(links, middles, unit, factors)
    name, model, parents, residual = _fitted(links, seen, middles, unit, factors, given)
    kept = _without_wrong(links, seen, model)
    if len(kept) < len(links):
        seen = observe(kept, middles, unit, factors)
        name, model, parents, residual = _fitted(kept, seen, middles, unit, factors, given)
    scale = np.diag([unit, unit, 1.0])
    if isinstance(model, Rotations):
        return Alignment(
            name, scale @ model.matrices(), model.focals * unit, model.rotations, parents, residual,
            model.bend / unit**2,
        )  # fmt: skip
    flat = scale @ model.matrices() @ np.linalg.inv(scale)
    return Alignment(name, flat, None, None, parents, residual)


def _fitted(
    links: Sequence[Link],
    seen: Observations,
    middles: np.ndarray,
    unit: float,
    factors: np.ndarray,
    given: np.ndarray | None,
) -> tuple[str, Any, np.ndarray, float]:
    """Return the name, the model, the spanning tree and the residual of the model of the links."""
    count = len(middles)
    maps = _unit_maps(links, middles, unit)
    parents, order = spanning_tree(count, links)
    few = observe(links, middles, unit, factors, FEW_POINTS)
    turning = _turned((few, seen), maps, parents, order, count, None)
    left = _left(seen, turning)
    if given is not None:
        told = _turned((few, seen), maps, parents, order, count, given)
        # Focal lengths that the matches contradict come from cropped pictures or other cameras.
        if _left(seen, told) <= CONTRADICTED * left:
            turning, left = told, _left(seen, told)
    plausible = turning.focals.max() <= FARTHEST_FOCAL
    ahead = turning.rotations[:, 2]
    if plausible and left <= SMALL and (ahead @ ahead.T).min() < WIDE:
        return "rotation", turning, parents, left
    affine = _flat(seen, maps, parents, order, 6)
    affine_left = _left(seen, affine)
    is_flat = affine_left <= WORST and (affine_left <= FLAT * left or not plausible)
    if plausible and left <= SMALL and not is_flat:
        return "rotation", turning, parents, left
    full = _facing(_flat(seen, maps, parents, order, 8), middles / unit)
    full_left = _left(seen, full) if _in_front(full, middles / unit) else np.inf
    if is_flat and full_left >= MUCH_BETTER * affine_left:
        return "affine", affine, parents, affine_left
    if plausible and left <= min(WORST, FAR_WORSE * full_left) and not is_flat:
        return "rotation", turning, parents, left
    if full_left <= WORST:
        return "homography", full, parents, full_left
    plane = _facing(Planes(_chained(maps, parents, order, 8), 8), middles / unit)
    name = "homography tree"
    if not _in_front(plane, middles / unit):
        plane, name = Planes(_chained(maps, parents, order, 4), 8), "similarity tree"
    return name, plane, parents, _left(seen, plane)


def _left(seen: Observations, model: Any) -> float:
    """Return the root mean square of the best residuals of a model."""
    off = np.sort(np.hypot(*residuals(seen, model).T))
    most = off[: max(1, int(MOST * len(off)))]
    return float(np.sqrt(np.mean(most**2)))


def _in_front(model: Planes, reach: np.ndarray) -> bool:
    """Tell whether every image lies on its plane, far from the horizon; `reach` (N, 2) in units."""
    return _least_depth(model.matrices(), reach) > HORIZON


def _facing(model: Planes, reach: np.ndarray) -> Planes:
    """Return the model in the plane of the central image, if all images lie there, far enough.

    Else in that of the image from which they lie farthest from the horizon.
    """
    if _in_front(model, reach):
        return model
    matrices = model.matrices()
    planes = [with_unit_determinant(matrices @ inverse) for inverse in np.linalg.inv(matrices)]
    depths = [_least_depth(plane, reach) for plane in planes]
    return Planes(planes[int(np.argmax(depths))], model.size)


def _least_depth(matrices: np.ndarray, reach: np.ndarray) -> float:
    """Return the least depth of a corner of an image, in depths of its middle; at most 1."""
    x, y = reach.T
    one = np.ones_like(x)
    corners = np.array(
        [[0 * x, 0 * x, one], *((a * x, b * y, one) for a in (-1, 1) for b in (-1, 1))]
    )
    depths = np.einsum("ni,cin->cn", np.linalg.inv(matrices)[:, 2], corners)
    with np.errstate(divide="ignore", invalid="ignore"):
        least = (depths / np.abs(depths[0])).min()
    return float(least) if np.isfinite(least) else -math.inf


def _without_wrong(links: Sequence[Link], seen: Observations, model: Any) -> list[Link]:
    """Leave out pairs that contradict all others, if the rest stays connected."""
    # Each link has two directions: use the one from its first image.
    off = medians(seen, model)[::2]
    limit = max(WORST, WRONG * float(np.median(off)))
    kept = [link for link, median in zip(links, off, strict=True) if median <= limit]
    joined = connected(len(model.matrices()), [(link.first, link.second) for link in kept])
    return kept if len(joined) == 1 else list(links)


def _unit_maps(
    links: Sequence[Link], middles: np.ndarray, unit: float
) -> dict[tuple[int, int], np.ndarray]:
    """Return the homographies of linked images, in the coordinates of the adjustment."""
    ends = np.stack([np.array([[unit, 0, x], [0, unit, y], [0, 0, 1]]) for x, y in middles])
    begins = np.linalg.inv(ends)
    maps = {}
    for link in links:
        matrix = with_unit_determinant(begins[link.second] @ link.matrix @ ends[link.first])
        maps[link.first, link.second] = matrix
        maps[link.second, link.first] = np.linalg.inv(matrix)
    return maps


def spanning_tree(count: int, links: Sequence[Link]) -> tuple[np.ndarray, list[int]]:
    """Return the parents in the tree with most inliers, and its images from the centre outwards.

    The centre is the image with the least sum of distances, counted in links of the tree.
    """
    near: dict[int, list[int]] = {i: [] for i in range(count)}
    joined = list(range(count))
    weights = {}
    for link in sorted(links, key=lambda k: (-len(k.points0), k.first, k.second)):
        weights[link.first, link.second] = weights[link.second, link.first] = len(link.points0)
        a, b = joined[link.first], joined[link.second]
        if a != b:
            joined = [a if group == b else group for group in joined]
            near[link.first].append(link.second)
            near[link.second].append(link.first)

    def distances(start: int) -> int:
        depth, queue = {start: 0}, [start]
        for i in queue:
            for j in near[i]:
                if j not in depth:
                    depth[j] = depth[i] + 1
                    queue.append(j)
        return sum(depth.values())

    centre = min(range(count), key=lambda i: (distances(i), i))
    parents, order = np.full(count, -1), [centre]
    edges = [(-weights[centre, j], j, centre) for j in near[centre]]
    heapq.heapify(edges)
    # Each round adds an image, and the edges that lead on from it.
    while edges:
        _, j, i = heapq.heappop(edges)
        parents[j] = i
        order.append(j)
        for k in near[j]:
            if k != i:
                heapq.heappush(edges, (-weights[j, k], k, j))
    return parents, order


def first_focal(maps: dict[tuple[int, int], np.ndarray]) -> float:
    """Return the focal length that makes the homographies most similar to rotations."""
    matrices = np.stack(list(maps.values()))
    scores = []
    for f in FOCALS:
        k = np.array([f, f, 1.0])
        turned = with_unit_determinant(matrices * k / k[:, None])
        off = turned.swapaxes(1, 2) @ turned - np.eye(3)
        scores.append(np.minimum(np.linalg.norm(off, axis=(1, 2)), 1.0).mean())
    return float(FOCALS[int(np.argmin(scores))])


def _turned(
    seen: tuple[Observations, Observations],
    maps: dict[tuple[int, int], np.ndarray],
    parents: np.ndarray,
    order: list[int],
    count: int,
    given: np.ndarray | None,
) -> Rotations:
    """Fit rotations: add images from the centre of the tree outwards, with a few matches each."""
    known = np.zeros(count, bool) if given is None else np.isfinite(given)
    start = first_focal(maps)
    if given is not None and known.any():
        start = float(np.median(given[known]))
    focals = np.full(count, start) if given is None else np.where(known, given, start)
    spread = GIVEN_SPREAD if known.any() else adjustment.FOCAL_SPREAD
    model = Rotations(
        np.stack([np.eye(3)] * count), focals, focals if known.any() else None, spread
    )
    there = np.zeros(count, bool)
    there[order[0]] = True
    fixed = np.ones((count, 4), bool)
    grown = 1
    for number, image in enumerate(order[1:], 2):
        beside = int(parents[image])
        if not known[image]:
            model.focals[image] = model.focals[beside]
        k0, k1 = (np.array([f, f, 1.0]) for f in model.focals[[beside, image]])
        turn = nearest_rotations(maps[beside, image] * k0 / k1[:, None])
        model.rotations[image] = turn @ model.rotations[beside]
        there[image] = True
        if number >= max(grown * AT_ONCE, grown + 1) or number == count:
            grown = number
            fixed[there], fixed[order[0], :3] = False, True
            model = adjust(part(seen[0], there), model, fixed, EARLY, steps=6)
    model = adjust(seen[0], model, fixed, adjustment.HUBER)
    model = adjust(seen[1], model, fixed, adjustment.HUBER)
    if _left(seen[1], model) < STRAIGHT:
        return model
    bent = adjust(seen[1], model.with_lens(), fixed, adjustment.HUBER)
    costs = [cost(seen[1], found, adjustment.HUBER) for found in (bent, model)]
    clearly = costs[0] < CLEARLY_BENT * costs[1]
    return bent if clearly and abs(bent.bend) <= MOST_BENT else model


def _flat(
    seen: Observations,
    maps: dict[tuple[int, int], np.ndarray],
    parents: np.ndarray,
    order: list[int],
    size: int,
) -> Planes:
    """Fit images of one plane."""
    model = Planes(_chained(maps, parents, order, size), size)
    fixed = np.zeros((len(parents), size), bool)
    fixed[order[0]] = True
    if not np.isfinite(residuals(seen, model)).all():
        return model
    for huber, steps in ((EARLY, 10), (adjustment.HUBER, adjustment.STEPS)):
        model = adjust(seen, model, fixed, huber, steps)
    return model


def _chained(
    maps: dict[tuple[int, int], np.ndarray], parents: np.ndarray, order: list[int], size: int
) -> np.ndarray:
    """Return the maps from the central image to all images, as products along the tree."""
    found = np.stack([np.eye(3)] * len(parents))
    for image in order[1:]:
        beside = int(parents[image])
        found[image] = _reduced(maps[beside, image], size) @ found[beside]
    return with_unit_determinant(found)


def _reduced(matrix: np.ndarray, size: int) -> np.ndarray:
    """Return the affine map (6) or similarity (4) that fits a homography best at the middle."""
    if size == 8:
        return matrix
    flat = matrix / matrix[2, 2]
    # The origin is the middle of the image: take the derivative there.
    linear = flat[:2, :2] - np.outer(flat[:2, 2], flat[2, :2])
    if size == 4:
        a, b = (linear[0, 0] + linear[1, 1]) / 2, (linear[1, 0] - linear[0, 1]) / 2
        linear = np.array([[a, -b], [b, a]])
    made = np.eye(3)
    made[:2, :2], made[:2, 2] = linear, flat[:2, 2]
    return made
