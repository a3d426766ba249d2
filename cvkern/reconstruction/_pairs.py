"""Pairs of photographs that show the same: matches, their geometry, and triplets that agree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.features._photographs import as_host
from cvkern.features.matching import match_images
from cvkern.geometry.epipolar import find_fundamentals
from cvkern.geometry.essential import find_essentials
from cvkern.geometry.maps import find_homographies
from cvkern.geometry.views import recover_pose
from cvkern.reconstruction._averaging import angles_between, average_turns
from cvkern.reconstruction._photographs import Keypoints, Lenses, rays_through
from cvkern.reconstruction._planes import motions_of
from cvkern.reconstruction._vocabulary import likeness, nearest_pairs

MAX_RATIO = 0.8  # nearest distance over the second nearest
LEAST_MATCHES = 15  # matches of a pair, before and after its geometry is known
THRESHOLD = 2.0  # Sampson distance of an inlier, pixels
FLAT_THRESHOLD = 3.0  # distance of an inlier from a homography's place, pixels
LEAST_SHARE = 0.25  # least share of the matches of a pair that must agree
# Up to `MANY` photographs, all pairs are matched. Up to `HUNDREDS`, the strongest keypoints of all
# pairs tell which are alike; beyond, the vocabulary does.
MANY, HUNDREDS, STRONG = 20, 100, 500
SEARCHED = 40  # pairs by which the focal length is estimated
FOCALS = np.geomspace(0.5, 3.4, 13)  # candidates for the focal length, in longest sides
TRIALS = 4096
MOST_FOCALS = 4  # focal lengths that are tried
AS_GOOD = 1.15  # focal lengths with a cost up to this many times the least are tried as well
APART = 1.5  # least ratio of two focal lengths that are tried
FLAT = 0.9  # share of matches on a plane above which the turn of a pair is uncertain
PLANE = 0.8  # share above which both motions that explain a plane are kept
APART_TURNS = np.radians(2)  # least angle between their turns
LOOP = np.radians(10)  # largest angle by which the turns of three pairs may fail to close


class Pair(NamedTuple):
    """Two photographs and the matches that agree with their geometry."""

    first: int
    second: int
    places: np.ndarray
    """Indices of the places in the first and in the second photograph, (M, 2)."""
    flat: float
    """Matches that a homography explains, as a share of those that an essential matrix does."""
    rotation: np.ndarray
    """X1 = R X0 + t, (3, 3)."""
    translation: np.ndarray
    """(3,), of length 1."""
    other: np.ndarray
    """Another motion that explains the matches of a plane, R and t side by side, (3, 4); NaN for
    pairs that are no plane."""


class Matched(NamedTuple):
    """Photographs with matches, before their geometry is known."""

    pairs: np.ndarray
    """(P, 2), i < j."""
    places: list[np.ndarray]
    """Indices of places, (M, 2) each."""


def match(rt: Runtime, found: list[Keypoints], pairs: np.ndarray) -> Matched:
    """Match pairs of photographs, (P, 2); those with too few matches are left out."""
    if not len(pairs):
        return Matched(np.zeros((0, 2), int), [])
    used, own = np.unique(pairs, return_inverse=True)
    descriptors = [found[i].descriptors for i in used]
    matches = match_images(descriptors, own.reshape(-1, 2), max_ratio=MAX_RATIO)
    kept, places = [], []
    for (i, j), pair in zip(pairs, matches, strict=True):
        pair = as_host(rt, pair)
        both = np.stack((found[i].place_of[pair[:, 0]], found[j].place_of[pair[:, 1]]), axis=1)
        both = np.unique(both, axis=0)
        # A place with several partners, through several descriptors, is ambiguous.
        for side in (0, 1):
            _, where, counts = np.unique(both[:, side], return_inverse=True, return_counts=True)
            both = both[counts[where.reshape(-1)] == 1]
        if len(both) >= LEAST_MATCHES:
            kept.append((i, j))
            places.append(both)
    return Matched(np.array(kept, int).reshape(-1, 2), places)


def choose_pairs(
    rt: Runtime, found: list[Keypoints], pairs: str | np.ndarray, neighbors: int
) -> np.ndarray:
    """Return the pairs (P, 2), i < j, to match: see :func:`cvkern.reconstruct`."""
    count = len(found)
    if not isinstance(pairs, str):
        return pairs
    whole = np.stack(np.triu_indices(count, 1), axis=1)
    if pairs == "all" or (pairs == "auto" and count <= MANY):
        return whole
    if pairs == "sequence":
        return whole[whole[:, 1] - whole[:, 0] <= neighbors]
    if pairs == "vocabulary" or count > HUNDREDS:
        return nearest_pairs(likeness(rt, found), neighbors)
    return nearest_pairs(_shared(rt, found, whole), neighbors)


def _shared(rt: Runtime, found: list[Keypoints], pairs: np.ndarray) -> np.ndarray:
    """Return how many strong matches photographs share, (N, N)."""
    strong = []
    for keypoints in found:
        order = np.argsort(-keypoints.responses, kind="stable")[:STRONG]
        strong.append(rt.give(as_host(rt, keypoints.descriptors)[np.sort(order)]))
    matches = match_images(strong, pairs, max_ratio=MAX_RATIO)
    numbers = np.zeros((len(found), len(found)))
    numbers[pairs[:, 0], pairs[:, 1]] = [len(m) for m in matches]
    return numbers + numbers.T


Points = list[tuple[np.ndarray, np.ndarray]]


def points_of(found: list[Keypoints], matched: Matched) -> Points:
    """Return (x, y) of the matches of each pair."""
    return [
        (found[i].places[places[:, 0]], found[j].places[places[:, 1]])
        for (i, j), places in zip(matched.pairs, matched.places, strict=True)
    ]


def with_focals(
    found: list[Keypoints], matched: Matched, lenses: Lenses, seed: int
) -> list[Lenses]:
    """Return the lenses with the focal lengths that fit the matches best, the best first.

    A focal length is good if essential matrices then explain the matches of many pairs. Cameras at
    one distance from the point that they look at leave it open: then there are several.
    """
    if lenses.told.all() or not len(matched.pairs):
        return [lenses]
    longest = 2 * lenses.rows[:, 2:4].max(axis=1, keepdims=True) + 1
    points = points_of(found, matched)
    most = sorted(range(len(points)), key=lambda k: (-len(points[k][0]), k))[: 3 * SEARCHED]
    given = [(points[k][0][:, ::-1], points[k][1][:, ::-1]) for k in most]
    # Pairs that a homography explains say nothing about the focal length.
    flat = find_homographies(given, FLAT_THRESHOLD, seed=seed)
    free = find_fundamentals(given, THRESHOLD, seed=seed)
    telling = []
    for n in range(len(most)):
        part = slice(flat.offsets[n], flat.offsets[n + 1])
        inliers = np.asarray(free.inliers[part])
        if inliers.sum() >= LEAST_MATCHES and np.asarray(flat.inliers[part])[inliers].mean() < 0.8:
            telling.append((given[n][0][inliers], given[n][1][inliers], most[n]))
    telling = telling[:SEARCHED]
    if not telling:
        telling = [(*given[n], most[n]) for n in range(min(len(most), SEARCHED))]
    costs = []
    for focal in FOCALS:
        rows = np.where(lenses.told[:, None], lenses.rows[:, :2], focal * longest)
        tried = lenses._replace(rows=np.concatenate((rows, lenses.rows[:, 2:]), axis=1))
        matrices = tried.matrices()[lenses.of]
        ends = matched.pairs[[k for _, _, k in telling]]
        fits = find_essentials(
            [(a, b) for a, b, _ in telling], matrices[ends[:, 0]], matrices[ends[:, 1]], THRESHOLD,
            max_trials=TRIALS, seed=seed,
        )  # fmt: skip
        costs.append(float(fits.costs.sum()))
    chosen: list[int] = []
    for k in np.argsort(costs, kind="stable"):
        alone = all(abs(np.log(FOCALS[k] / FOCALS[c])) >= np.log(APART) for c in chosen)
        if costs[k] <= AS_GOOD * min(costs) and alone:
            chosen.append(int(k))
    made = []
    for k in chosen[:MOST_FOCALS]:
        rows = lenses.rows.copy()
        rows[~lenses.told, :2] = FOCALS[k] * longest[~lenses.told]
        made.append(lenses._replace(rows=rows))
    return made


def verify(found: list[Keypoints], matched: Matched, lenses: Lenses, seed: int) -> list[Pair]:
    """Return the pairs whose matches one motion of a camera explains."""
    if not len(matched.pairs):
        return []
    matrices = lenses.matrices()[lenses.of]
    ends = matched.pairs
    given = []
    points = points_of(found, matched)
    for (i, j), (a, b) in zip(ends, points, strict=True):
        both = []
        for k, places in ((i, a), (j, b)):
            lens = lenses.rows[lenses.of[k]]
            straight = rays_through(places, lens) * lens[:2] + lens[2:4]
            both.append(np.ascontiguousarray(straight[:, ::-1]))
        given.append((both[0], both[1]))
    fits = find_essentials(
        given, matrices[ends[:, 0]], matrices[ends[:, 1]], THRESHOLD, max_trials=TRIALS, seed=seed
    )
    flat = find_homographies(given, FLAT_THRESHOLD, seed=seed)
    pairs = []
    for n, (i, j) in enumerate(ends.tolist()):
        part = slice(fits.offsets[n], fits.offsets[n + 1])
        inliers, plane = np.asarray(fits.inliers[part]), np.asarray(flat.inliers[part])
        number = int(inliers.sum())
        if number < max(LEAST_MATCHES, LEAST_SHARE * len(inliers)):
            continue
        a, b = given[n][0][inliers], given[n][1][inliers]
        try:
            pose = recover_pose(fits.matrices[n], a, b, matrices[i], matrices[j])
        except ValueError:  # no match is in front of both cameras
            continue
        share, other = int(plane.sum()) / number, np.full((3, 4), np.nan)
        if share > PLANE and (inliers & plane).any():
            inside = np.linalg.inv(matrices[j]) @ flat.matrices[n] @ matrices[i]
            rays = rays_through(points[n][0][inliers & plane], lenses.rows[lenses.of[i]])
            other = _other_motion(motions_of(inside, rays), pose.rotation)
        motion = pose.rotation, pose.translation, other
        pairs.append(Pair(i, j, matched.places[n][inliers], share, *motion))
    return pairs


def _other_motion(motions: list[tuple[np.ndarray, np.ndarray]], turn: np.ndarray) -> np.ndarray:
    """Return the motion whose turn differs most from the given one, if it does at all."""
    off = [float(angles_between(r, turn)) for r, _ in motions]
    if not off or max(off) < APART_TURNS:
        return np.full((3, 4), np.nan)
    return np.column_stack(motions[int(np.argmax(off))])


def consistent(pairs: list[Pair], count: int) -> list[Pair]:
    """Leave out pairs whose turn contradicts those of other pairs.

    Repeated things join photographs that have nothing in common: their turns do not close with
    those of other pairs. In each round, the pairs with the smallest share of triplets that close
    are left out, if that is below a half. Two turns explain a plane, so pairs of a plane are kept,
    and do not count against others.
    """
    turns = np.full((count, count, 3, 3), np.nan)
    index = np.full((count, count), -1)
    told = [(n, pair) for n, pair in enumerate(pairs) if pair.flat <= FLAT]
    for n, pair in told:
        turns[pair.first, pair.second] = pair.rotation
        turns[pair.second, pair.first] = pair.rotation.T
        index[pair.first, pair.second] = index[pair.second, pair.first] = n
    there = index >= 0
    good, bad = np.zeros((2, len(pairs), count), bool)
    for n, pair in told:
        others = np.flatnonzero(there[pair.first] & there[pair.second])
        closed = turns[others, pair.first] @ turns[pair.second, others] @ pair.rotation
        off = np.arccos(np.clip((np.trace(closed, axis1=1, axis2=2) - 1) / 2, -1, 1))
        good[n, others], bad[n, others] = off <= LOOP, off > LOOP
    kept = np.ones(len(pairs), bool)
    # Each round leaves out a pair at least: only shares of kept pairs are below 1.
    while kept.any():
        closing, all_of = good.sum(axis=1), (good | bad).sum(axis=1)
        share = np.where(kept & (all_of > 0), closing / np.maximum(all_of, 1), 1.0)
        worst = share.min()
        if worst >= 0.5:
            break
        for n in np.flatnonzero(share == worst):
            kept[n] = False
            i, j = pairs[n].first, pairs[n].second
            for k in np.flatnonzero(good[n] | bad[n]):
                for other, third in ((index[i, k], j), (index[j, k], i)):
                    good[other, third] = bad[other, third] = False
            good[n], bad[n] = False, False
    return [pair for pair, keep in zip(pairs, kept, strict=True) if keep]


def agreeing(pairs: list[Pair], count: int) -> list[Pair]:
    """Leave out pairs whose turn contradicts the turns of all photographs together.

    Pairs of a plane stay, but do not count: the one of their two motions that fits is taken.
    """
    told = [n for n, pair in enumerate(pairs) if pair.flat <= FLAT]
    if not told:
        return pairs
    ends = np.array([(pairs[n].first, pairs[n].second) for n in told])
    numbers = np.array([float(len(pairs[n].places)) for n in told])
    turns, off = average_turns(count, ends, np.stack([pairs[n].rotation for n in told]), numbers)
    wrong = {n for n, angle in zip(told, off, strict=True) if angle > LOOP}
    kept = []
    for n, pair in enumerate(pairs):
        if pair.flat > FLAT and np.isfinite(pair.other).all():
            between = turns[pair.second] @ turns[pair.first].T
            now, then = (angles_between(r, between) for r in (pair.rotation, pair.other[:, :3]))
            if then < min(now, LOOP):  # NaN is not
                other = np.column_stack((pair.rotation, pair.translation))
                pair = pair._replace(
                    rotation=pair.other[:, :3], translation=pair.other[:, 3], other=other
                )
        if n not in wrong:
            kept.append(pair)
    return kept
