"""Incremental reconstruction: a first pair, then one photograph after the other.

Each photograph is placed before the points that are there; then it gives new points. Bundle
adjustment of its surroundings follows each photograph, and adjustment of everything whenever the
number of photographs has grown by a quarter.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cvkern.geometry.cameras.lens import matrix_of
from cvkern.geometry.poses import find_pose
from cvkern.kernels.codes.reconstruction import POSE, Loss
from cvkern.reconstruction._adjustment import Bundle, Effort, adjust, gaps_of
from cvkern.reconstruction._pairs import Pair
from cvkern.reconstruction._photographs import Lenses, Say, rays_through
from cvkern.reconstruction._tracks import Tracks
from cvkern.reconstruction._triangulation import Rays, lengths_of, triangulate, widest_angles

ERROR = 4.0  # pixels: a place farther from its projected point does not belong to it
POSE_ERROR = 6.0  # the same while a photograph is placed
LEAST_ANGLE = np.radians(1.5)  # between two rays of a point, at least
LEAST_POINTS, LEAST_SHARE = 15, 0.2  # known points that a photograph must agree with
FIRST_ANGLES = np.radians((8.0, 4.0, 2.0))  # median angle of the first pair, in turn
FIRST_POINTS = 15  # points of the first pair
FLAT = 0.85  # share of matches on a plane above which a first pair is chosen last
FOR_TWINS = 4  # photographs by which the two motions of a plane are compared
TRIED = 60  # pairs that may be the first
NEAR = 5  # photographs that are adjusted with a new one
GROWN = 1.25  # growth of the number of photographs between adjustments of everything
ROUNDS = 4  # adjusting and cleaning at the end
NEAR_STEPS, FEW_STEPS, LAST_STEPS = 5, 8, 25  # steps of adjustments
# Photographs from which the focal length, k1 and k2, and the principal point are found.
FOR_FOCAL, FOR_LENS, FOR_MIDDLE = 3, 5, 8
NOISE = 0.05, 2.0  # pixels by which places are off, at least and at most
SCALE, LEAST_SCALE = 3.0, 0.25  # scale of the last loss: in units of the noise, and pixels

# Arrays of a state.
KEPT = "rows", "placed", "rotations", "translations", "points", "active", "origin"


class Growth:
    """A reconstruction that grows."""

    def __init__(self, tracks: Tracks, pairs: list[Pair], lenses: Lenses, seed: int):
        count = len(lenses.of)
        self.tracks, self.pairs, self.lenses, self.seed = tracks, pairs, lenses, seed
        self.rows = lenses.rows.copy()
        self.placed = np.zeros(count, bool)
        self.rotations, self.translations = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
        self.points = np.full((tracks.total, 3), np.nan)
        self.active = np.zeros(len(tracks.track), bool)
        self.origin = np.arange(len(tracks.track))
        """The first sighting that is of the same place of the same photograph."""
        self.failed: dict[int, int] = {}
        """The number of known points with which a photograph could not be placed."""
        self.adjusted = 0
        """Placed photographs when everything was adjusted last."""
        self.rounds = 0
        """Rounds of the end: the one that comes next, 0 before the end."""
        self._straighten()

    def state(self) -> dict[str, np.ndarray]:
        """Return copies of all that changes while the model grows."""
        failed = np.array(list(self.failed.items()), int).reshape(-1, 2)
        whole = {name: getattr(self, name).copy() for name in KEPT}
        tracks = {name: getattr(self.tracks, name).copy() for name in Tracks._fields[:-1]}
        counts = np.array([self.adjusted, self.rounds])
        return {**whole, **tracks, "failed": failed, "counts": counts}

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Go back to a state."""
        for name in KEPT:
            setattr(self, name, state[name].copy())
        track, view, where, color = (state[name].copy() for name in Tracks._fields[:-1])
        self.tracks = Tracks(track, view, where, color, len(self.points))
        self.failed = dict(state["failed"].tolist())
        self.adjusted, self.rounds = state["counts"].tolist()
        self._straighten()

    # --- the first pair --------------------------------------------------------------------------

    def begin(self) -> bool:
        """Place the first two photographs; False if no pair has enough parallax."""
        ranked = sorted(
            self.pairs, key=lambda p: (-len(p.places) * (1.0 if p.flat < FLAT else 0.3), p.first)
        )[:TRIED]
        tried = []
        for pair in ranked:
            self._place_two(pair)
            known = np.isfinite(self.points[:, 0])
            if known.sum() >= FIRST_POINTS:
                angles = self._angles()[known]
                tried.append((pair, int(known.sum()), float(np.median(angles))))
            self._clear()
        for least in FIRST_ANGLES:
            wide = [(n, -k) for k, (pair, n, angle) in enumerate(tried) if angle >= least]
            if wide:
                self._begin_with(tried[-max(wide)[1]][0])
                return True
        return False

    def _begin_with(self, pair: Pair) -> None:
        """Place a pair; of a plane, with the motion by which more photographs fit better."""
        twin = pair._replace(rotation=pair.other[:, :3], translation=pair.other[:, 3])
        two = [pair] if pair.flat < FLAT or np.isnan(twin.rotation[0, 0]) else [pair, twin]
        scores = []
        for one in two:
            self._clear()
            self._place_two(one)
            self._adjust_all(FEW_STEPS)
            self.adjusted = 2
            if len(two) > 1:
                start = self.state()
                self.grow(lambda *given: None, FOR_TWINS)
                number, error = self.cost()
                scores.append((-number * max(0.0, ERROR - error), len(scores), start))
        if scores:
            self.restore(min(scores[0], scores[1], key=lambda s: s[:2])[2])

    def _place_two(self, pair: Pair) -> None:
        self.placed[[pair.first, pair.second]] = True
        self.rotations[pair.second], self.translations[pair.second] = (
            pair.rotation,
            pair.translation,
        )
        self._add_points()

    def _clear(self) -> None:
        self.placed[:], self.active[:], self.points[:] = False, False, np.nan
        self.rotations[:], self.translations[:] = np.eye(3), 0
        self.failed, self.adjusted = {}, 0
        if not np.array_equal(self.rows, self.lenses.rows):
            self.rows = self.lenses.rows.copy()
            self._straighten()

    # --- further photographs ---------------------------------------------------------------------

    def grow(
        self, say: Say, most: int | None = None, save: Callable[[], None] = lambda: None
    ) -> None:
        """Place photographs until none can be placed, or until `most` are."""
        total = len(self.placed)
        # Placed photographs stay placed. For each number of them there is at most one settling, and
        # before and after it each of the others fails once at most, as what it shows stays.
        while not self.placed.all() and (most is None or self.placed.sum() < most):
            save()
            say(int(self.placed.sum()), total, "Placing photographs")
            visible = self._visible()
            order = [
                int(v) for v in np.argsort(-visible, kind="stable")
                if visible[v] >= LEAST_POINTS and visible[v] > self.failed.get(int(v), 0)
            ]  # fmt: skip
            if not order:
                if self.adjusted == self.placed.sum():
                    break
                self.settle()
                self.adjusted = int(self.placed.sum())
                self.failed = {}
                continue
            view = order[0]
            if not self._place(view):
                self.failed[view] = int(1.1 * visible[view])
                continue
            self._add_points()
            self._adjust_near(view)
            self._add_points()
            now = int(self.placed.sum())
            if now >= max(GROWN * self.adjusted, self.adjusted + 1) or now <= FOR_LENS + 1:
                self._adjust_all(FEW_STEPS)
                self._add_points()
                self.adjusted = now

    def settle(self, last: bool = False) -> bool:
        """Adjust everything, remove outliers, look for more views; True if nothing changed.

        In the end, `last`, with more steps and all parameters of the lens.
        """
        before = self.active.copy()
        self._adjust_all(LAST_STEPS if last else FEW_STEPS, last)
        self._add_points()
        return bool((before != self.active).sum() <= 1e-3 * max(1, before.sum()))

    def _visible(self) -> np.ndarray:
        """Return how many known points each photograph without a place shows."""
        known = np.isfinite(self.points[self.tracks.track, 0])
        counts = np.bincount(self.tracks.view[known], minlength=len(self.placed))
        return np.where(self.placed, 0, counts)

    def _place(self, view: int) -> bool:
        tracks = self.tracks
        own = np.flatnonzero(tracks.view == view)
        own = own[np.isfinite(self.points[tracks.track[own], 0])]
        lens = self.rows[self.lenses.of[view]]
        matrix = matrix_of(*lens[:4])
        straight = self.straight[own] * lens[:2] + lens[2:4]
        pose = find_pose(
            self.points[tracks.track[own]], np.ascontiguousarray(straight[:, ::-1]), matrix,
            POSE_ERROR, seed=self.seed,
        )  # fmt: skip
        inliers = np.asarray(pose.inliers)
        if pose.rotation is None or pose.translation is None:
            return False
        if inliers.sum() < max(LEAST_POINTS, LEAST_SHARE * len(own)):
            return False
        self.placed[view] = True
        self.rotations[view], self.translations[view] = pose.rotation, pose.translation
        self.active[own[inliers]] = True
        return True

    # --- points ----------------------------------------------------------------------------------

    def _straighten(self) -> None:
        """Find the rays of all places, with the lenses of now."""
        self.straight = np.zeros_like(self.tracks.where)
        lens_of = self.lenses.of[self.tracks.view]
        for n, lens in enumerate(self.rows):
            own = lens_of == n
            self.straight[own] = rays_through(self.tracks.where[own], lens)

    def _rays(self, chosen: np.ndarray) -> Rays:
        """Return the rays of some sightings, in the world."""
        view = self.tracks.view[chosen]
        flat = np.concatenate((self.straight[chosen], np.ones((len(chosen), 1))), axis=1)
        turns = self.rotations[view]
        ahead = np.einsum("oji,oj->oi", turns, flat)
        eyes = -np.einsum("nji,nj->ni", self.rotations, self.translations)[view]
        ahead /= lengths_of(ahead)[:, None]
        return Rays(self.tracks.track[chosen], eyes, ahead, view)

    def _angles(self) -> np.ndarray:
        """Return the widest angle between the rays of each point, (T,)."""
        return widest_angles(self._rays(np.flatnonzero(self.active)), self.tracks.total)

    def _errors(self, chosen: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return the distances of places from projected points, (len(chosen),), pixels."""
        view = self.tracks.view[chosen]
        inside = np.einsum("oij,oj->oi", self.rotations[view], points) + self.translations[view]
        with np.errstate(all="ignore"):
            off = inside[:, :2] / inside[:, 2:] - self.straight[chosen]
            off = lengths_of(off * self.rows[self.lenses.of[view], :2])
        return np.where(inside[:, 2] > 0, off, np.inf)

    def _add_points(self) -> None:
        """Find points of tracks without one, and take in sightings that fit."""
        tracks = self.tracks
        known = np.isfinite(self.points[:, 0])
        open_ = np.flatnonzero(self.placed[tracks.view] & ~known[tracks.track])
        found = triangulate(
            self._rays(open_), LEAST_ANGLE, ERROR, lambda points: self._errors(open_, points),
            self.seed,
        )  # fmt: skip
        self.points[found.tracks] = found.points
        self._clean()
        self._split()

    def _split(self) -> None:
        """Give places that do not fit the point of their track a point of their own.

        Things that look alike, the windows of a facade for example, may be joined to one track. The
        places of photographs that are not placed yet stay with both points.
        """
        tracks, known = self.tracks, np.isfinite(self.points[:, 0])
        free = np.ones(len(self.origin), bool)
        free[self.origin[self.active]] = False
        left = self.placed[tracks.view] & known[tracks.track] & free[self.origin]
        several = np.bincount(tracks.track[left], minlength=tracks.total) > 1
        chosen = np.flatnonzero(left & several[tracks.track])
        found = triangulate(
            self._rays(chosen), LEAST_ANGLE, ERROR, lambda points: self._errors(chosen, points),
            self.seed,
        )  # fmt: skip
        if not len(found.tracks):
            return
        fresh = np.full(tracks.total, -1)
        fresh[found.tracks] = tracks.total + np.arange(len(found.tracks))
        points = np.concatenate((self.points, found.points))
        own = fresh[tracks.track[chosen]]
        fits = chosen[(own >= 0) & (self._errors(chosen, points[own]) <= ERROR)]
        open_ = np.flatnonzero(~self.placed[tracks.view] & (fresh[tracks.track] >= 0))
        track = tracks.track.copy()
        track[fits] = fresh[track[fits]]
        whole = np.concatenate((np.arange(len(track)), open_))
        track = np.concatenate((track, fresh[tracks.track[open_]]))
        order = np.lexsort((tracks.view[whole], track))
        whole, self.points = whole[order], points
        self.active[fits] = True
        self.active = self.active[whole]
        self.origin, self.straight = self.origin[whole], self.straight[whole]
        self.tracks = Tracks(
            track[order], tracks.view[whole], tracks.where[whole], tracks.color[whole], len(points)
        )

    def _clean(self) -> None:
        """Decide which sightings belong to points, and drop points that too few rays fix."""
        tracks = self.tracks
        known = np.isfinite(self.points[:, 0])
        chosen = np.flatnonzero(self.placed[tracks.view] & known[tracks.track])
        off = self._errors(chosen, self.points[tracks.track[chosen]])
        self.active[:] = False
        # A place that fits two points goes to the nearer one.
        fits = chosen[off <= ERROR]
        fits = fits[np.argsort(off[off <= ERROR], kind="stable")]
        self.active[fits[np.unique(self.origin[fits], return_index=True)[1]]] = True
        wide = self._angles() >= LEAST_ANGLE
        self.points[known & ~wide] = np.nan
        self.active &= wide[tracks.track]

    # --- adjustment ------------------------------------------------------------------------------

    def _bundle(self, chosen: np.ndarray) -> tuple[Bundle, np.ndarray, np.ndarray]:
        """Return the bundle of some sightings, its photographs and its tracks."""
        views, view = np.unique(self.tracks.view[chosen], return_inverse=True)
        names, point = np.unique(self.tracks.track[chosen], return_inverse=True)
        bundle = Bundle(
            self.rotations[views], self.translations[views], self.rows, self.lenses.of[views],
            self.points[names], np.stack((view.reshape(-1), point.reshape(-1)), axis=1),
            self.tracks.where[chosen],
        )  # fmt: skip
        return bundle, views, names

    def _take(self, bundle: Bundle, views: np.ndarray, names: np.ndarray) -> None:
        self.rotations[views], self.translations[views] = bundle.rotations, bundle.translations
        self.points[names] = bundle.points

    def _adjust_near(self, view: int) -> None:
        """Adjust a photograph, those that share most points with it, and their points."""
        tracks = self.tracks
        own = np.zeros(tracks.total, bool)
        own[tracks.track[self.active & (tracks.view == view)]] = True
        shared = np.bincount(
            tracks.view[self.active & own[tracks.track]], minlength=len(self.placed)
        )
        shared[view] = 0
        near = np.argsort(-shared, kind="stable")[:NEAR]
        moving = np.zeros(len(self.placed), bool)
        moving[near[shared[near] > 0]] = True
        if moving.sum() + 1 >= self.placed.sum():
            moving[np.flatnonzero(self.placed)[0]] = False
        moving[view] = True
        about = np.zeros(tracks.total, bool)
        about[tracks.track[self.active & moving[tracks.view]]] = True
        bundle, views, names = self._bundle(np.flatnonzero(self.active & about[tracks.track]))
        effort = Effort(POSE, Loss.CAUCHY, 2.0, NEAR_STEPS, 1e-3)
        self._take(adjust(bundle, effort, ~moving[views])[0], views, names)
        self._clean()

    def _adjust_all(self, steps: int, last: bool = False) -> None:
        """Adjust everything, with the parameters of lenses that the photographs determine."""
        number = int(self.placed.sum())
        size = POSE
        if not self.lenses.fixed:
            size += (number >= FOR_FOCAL) + 2 * (number >= FOR_LENS)
            size += 2 * (number >= FOR_MIDDLE and last)
        bundle, views, names = self._bundle(np.flatnonzero(self.active))
        if not len(views):
            return
        noise = float(np.clip(np.median(np.abs(gaps_of(bundle))) / 0.67, *NOISE))
        scale = 2.0 if not last else max(LEAST_SCALE, SCALE * noise)
        effort = Effort(size, Loss.CAUCHY, scale, steps, 1e-6, self.lenses.rows, noise)
        bundle, _ = adjust(bundle, effort)
        self._take(bundle, views, names)
        self.rows = bundle.lenses
        self._straighten()
        self._clean()

    def distances(self, chosen: np.ndarray) -> np.ndarray:
        """Return the distances of places from projected points, pixels of the small images."""
        if not len(chosen):
            return np.zeros(0)
        return np.linalg.norm(gaps_of(self._bundle(chosen)[0]), axis=1)

    def cost(self) -> tuple[int, float]:
        """Return the number of places that fit, and their mean distance, pixels."""
        off = self.distances(np.flatnonzero(self.active))
        return len(off), float(off.mean()) if len(off) else np.inf
