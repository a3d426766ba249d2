"""Least squares of cameras and points together, by Schur's complement and damped steps.

Points are eliminated first: the equations of the views that are left are dense and are solved by
Cholesky's method. Views with one lens share its parameters: kernels treat every view as if it had a
lens of its own, and the sums over views with one lens are the equations of that lens.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime, runtime
from cvkern.geometry.cameras.lens import focal_and_center
from cvkern.kernels.codes.reconstruction import (
    POSE,
    Condensed,
    Eliminated,
    Loss,
    Scenery,
    Sightings,
    Slopes,
)
from cvkern.panorama.adjustment import turn

STEPS = 50
ENOUGH = 1e-7  # the steps end when the cost falls by less than this share of it
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-4, 1e-8, 1e8
# Standard deviations of k1 and k2, and of the principal point about the middle of the image, in
# longest sides. Errors of neighbouring places are alike, so that many count as one.
BEND_SPREAD, MIDDLE_SPREAD, ALIKE = 0.2, 0.01, 30.0
WEAK = 1e-12  # added to the equations' diagonal, as a share of its largest number


class Bundle(NamedTuple):
    """Cameras, points, and where the cameras see the points, on the host."""

    rotations: np.ndarray
    """(C, 3, 3), X = R W + t."""
    translations: np.ndarray
    """(C, 3)."""
    lenses: np.ndarray
    """fx, fy, cx, cy, k1, k2, p1, p2, k3, (L, 9)."""
    lens_of: np.ndarray
    """The lens of each view, (C,)."""
    points: np.ndarray
    """(P, 3)."""
    seen: np.ndarray
    """View and point of each sighting, (O, 2), in the order of the points, then the views."""
    where: np.ndarray
    """(x, y) of each sighting, (O, 2) float64."""


class Effort(NamedTuple):
    """How a bundle is adjusted."""

    size: int = POSE
    """Parameters of a view: one of `SIZES`."""
    loss: Loss = Loss.CAUCHY
    scale: float = 2.0
    """Pixels at which the loss begins to differ from squares."""
    steps: int = STEPS
    enough: float = ENOUGH
    anchor: np.ndarray | None = None
    """Likely lenses (L, 9), from which k1, k2 and the principal point do not move far."""
    noise: float = 0.2
    """Pixels by which places are off: it weighs the anchor against them."""


def lens_row(camera: Any) -> np.ndarray:
    """Return the nine numbers of a camera: fx, fy, cx, cy and its distortion."""
    return np.concatenate((focal_and_center(camera.matrix), camera.distortion))


def cost_of(gaps: np.ndarray, loss: Loss, scale: float) -> float:
    """Return the cost of residuals (O, 2)."""
    squares = (gaps * gaps).sum(axis=1)
    if loss == Loss.HUBER:
        lengths = np.sqrt(squares)
        squares = np.where(lengths <= scale, squares, scale * (2 * lengths - scale))
    elif loss == Loss.CAUCHY:
        squares = scale * scale * np.log1p(squares / (scale * scale))
    return float(squares.sum()) / 2


def gaps_of(bundle: Bundle) -> np.ndarray:
    """Return projected less seen places (O, 2), pixels; `BEHIND` for points behind a view."""
    return _Equations(runtime(), bundle, Effort()).gaps(bundle)


def adjust(
    bundle: Bundle, effort: Effort, fixed: np.ndarray | None = None
) -> tuple[Bundle, np.ndarray]:
    """Return a bundle with a smaller cost, and its residuals (O, 2).

    `fixed` (C,) marks views that do not move, nor do their lenses. Without one, the first view
    does not move.
    """
    equations = _Equations(runtime(), bundle, effort)
    still = np.arange(len(bundle.rotations)) == 0 if fixed is None else fixed
    held = np.zeros(len(bundle.lenses), bool)
    if fixed is not None:
        held[bundle.lens_of[fixed]] = True
    gaps = equations.gaps(bundle)
    best, damping = _whole_cost(bundle, gaps, effort), FIRST_DAMPING
    for _ in range(effort.steps if len(bundle.seen) else 0):
        equations.linearise(bundle)
        before = best
        while damping <= MOST_DAMPING:
            change = equations.step(bundle, still, held, damping)
            if change is not None:
                tried = _moved(bundle, effort.size, *change)
                there = equations.gaps(tried)
                now = _whole_cost(tried, there, effort)
                if np.isfinite(now) and now < best:
                    bundle, gaps, best = tried, there, now
                    break
            damping *= 10
        damping = max(damping / 10, LEAST_DAMPING)
        if before - best <= effort.enough * before:
            break
    return bundle, gaps


def _whole_cost(bundle: Bundle, gaps: np.ndarray, effort: Effort) -> float:
    pull, stiffness = _anchored(bundle, effort)
    anchored = float((pull * pull / np.where(stiffness > 0, stiffness, 1)).sum())
    return cost_of(gaps, effort.loss, effort.scale) + anchored / 2


def _anchored(bundle: Bundle, effort: Effort) -> tuple[np.ndarray, np.ndarray]:
    """Return gradient and curvature of the cost of lenses far from their anchor, (L, K - 6)."""
    number = effort.size - POSE
    order = [1, 4, 5, 2, 3]  # focal length (free), k1, k2, principal point
    off, stiffness = np.zeros((2, len(bundle.lenses), 5))
    if effort.anchor is not None:
        off = (bundle.lenses - effort.anchor)[:, order]
        stiffness[:, 1:3] = ALIKE * (effort.noise / BEND_SPREAD) ** 2
        longest = 2 * effort.anchor[:, 2:4].max(axis=1, keepdims=True) + 1
        stiffness[:, 3:] = ALIKE * (effort.noise / (MIDDLE_SPREAD * longest)) ** 2
    return (off * stiffness)[:, :number], stiffness[:, :number]


def _moved(
    bundle: Bundle, size: int, poses: np.ndarray, lenses: np.ndarray, moves: np.ndarray
) -> Bundle:
    """Return the bundle after steps of poses (C, 6), lenses (L, K - 6) and points (P, 3)."""
    turns = turn(poses[:, :3])
    # The turn is about the origin of the world, before the shift.
    changed = bundle.lenses.copy()
    if size > POSE:
        changed[:, :2] *= np.exp(np.clip(lenses[:, :1], -0.5, 0.5))
    if size > POSE + 1:
        changed[:, 4:6] += lenses[:, 1:3]
    if size > POSE + 3:
        changed[:, 2:4] += lenses[:, 3:5]
    return bundle._replace(
        rotations=turns @ bundle.rotations,
        translations=bundle.translations + poses[:, 3:],
        lenses=changed,
        points=bundle.points + moves,
    )


class _Equations:
    """The equations of a step, where kernels are."""

    def __init__(self, rt: Runtime, bundle: Bundle, effort: Effort):
        self.rt, self.effort = rt, effort
        self.kernels = rt.reconstruction.adjustment
        views, count = len(bundle.rotations), len(bundle.seen)
        view, point = bundle.seen.T
        counts = np.bincount(point, minlength=len(bundle.points))
        spans = np.stack((np.cumsum(counts) - counts, counts), axis=1)
        by_view = np.bincount(view, minlength=views)
        ranges = np.stack((np.cumsum(by_view) - by_view, by_view), axis=1)
        ends = np.stack((view, bundle.lens_of[view], point), axis=1)
        self.sightings = Sightings(
            rt.send("bundle.where", np.ascontiguousarray(bundle.where, np.float64)),
            rt.send("bundle.ends", ends.astype(np.int32)),
            rt.send("bundle.spans", spans.astype(np.int32)),
            rt.send("bundle.order", np.argsort(view, kind="stable").astype(np.int32)),
            rt.send("bundle.ranges", ranges.astype(np.int32)),
        )
        shapes = {"gaps": (count, 2), "weights": (count,), "slopes": (count, 2, 3 + effort.size)}
        self._gaps = rt.scratch("bundle.tried", (count, 2), np.float64)
        self.slopes = Slopes(*(self._room(name, shapes[name]) for name in Slopes._fields))
        points = len(bundle.points)
        self.eliminated = Eliminated(
            self._room("inverses", (points, 6)), self._room("pulls", (points, 3))
        )
        size = effort.size
        self.condensed = Condensed(
            self._room("system", (views, size, views, size)),
            self._room("right", (views, size)),
            self._room("sizes", (views, size)),
        )
        self._moves = self._room("moves", (points, 3))

    def _room(self, name: str, shape: tuple[int, ...]) -> Any:
        return self.rt.scratch(f"bundle.{name}", shape, np.float64)

    def _scenery(self, bundle: Bundle) -> Scenery:
        views = np.concatenate((bundle.rotations.reshape(-1, 9), bundle.translations), axis=1)
        return Scenery(
            self.rt.send("bundle.views", views),
            self.rt.send("bundle.lenses", np.ascontiguousarray(bundle.lenses)),
            self.rt.send("bundle.points", np.ascontiguousarray(bundle.points)),
        )

    def gaps(self, bundle: Bundle) -> np.ndarray:
        """Return the residuals (O, 2)."""
        if len(bundle.seen):
            self.kernels.measure(self._scenery(bundle), self.sightings, self._gaps)
        return np.array(self.rt.to_numpy(self._gaps))

    def linearise(self, bundle: Bundle) -> None:
        """Find the derivatives at a bundle."""
        effort = self.effort
        self.kernels.linearise(
            self._scenery(bundle), self.sightings, int(effort.loss), effort.scale, self.slopes
        )

    def step(
        self, bundle: Bundle, fixed: np.ndarray, held: np.ndarray, damping: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Return steps of poses, lenses and points, or None if the equations have no solution."""
        from scipy.linalg import LinAlgError, cho_factor, cho_solve

        kernels, rt, size = self.kernels, self.rt, self.effort.size
        kernels.eliminate(self.slopes, self.sightings, damping, self.eliminated)
        kernels.condense(self.slopes, self.sightings, self.eliminated, self.condensed)
        system, right, sizes = (np.array(rt.to_numpy(a)) for a in self.condensed)
        kinds = len(bundle.lenses)
        members = (bundle.lens_of[:, None] == np.arange(kinds)).astype(np.float64)  # (C, L)
        whole, gradient, diagonal = _shared(system, right, sizes, members)
        pull, stiffness = _anchored(bundle, self.effort)
        gradient[len(gradient) - pull.size :] += pull.ravel()
        diagonal[len(gradient) - pull.size :] += stiffness.ravel()
        more = np.arange(len(gradient) - pull.size, len(gradient))
        whole[more, more] += stiffness.ravel()
        still = np.repeat(fixed, POSE)
        still = np.append(still, np.repeat(held, size - POSE))
        free = np.flatnonzero(~still)
        steps = np.zeros(len(still))
        if len(free):
            part = whole[np.ix_(free, free)]
            part[np.diag_indices(len(free))] += damping * diagonal[free] + WEAK * (
                1 + diagonal.max()
            )
            if not np.isfinite(part).all():
                return None
            try:
                factor = cho_factor(part, lower=True, overwrite_a=True, check_finite=False)
            except LinAlgError:
                return None
            steps[free] = -cho_solve(factor, gradient[free], check_finite=False)
        views = len(fixed)
        poses = steps[: views * POSE].reshape(views, POSE)
        lenses = steps[views * POSE :].reshape(kinds, size - POSE)
        own = np.concatenate((poses, lenses[bundle.lens_of]), axis=1)
        kernels.substitute(
            self.slopes, self.sightings, self.eliminated,
            rt.send("bundle.steps", np.ascontiguousarray(own)), self._moves,
        )  # fmt: skip
        return poses, lenses, np.array(rt.to_numpy(self._moves))


def _shared(
    system: np.ndarray, right: np.ndarray, sizes: np.ndarray, members: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the equations of poses, then of lenses: matrix, gradient, and undamped diagonal."""
    (views, kinds), size = members.shape, right.shape[1]
    more = size - POSE
    flat = system.reshape(views * size, views * size)
    # Kernels write the blocks above the diagonal; those on it are whole.
    own = system[np.arange(views), :, np.arange(views)]
    flat = flat + flat.T
    whole = flat.reshape(system.shape)
    whole[np.arange(views), :, np.arange(views)] = own
    poses = views * POSE
    total = poses + kinds * more
    found, gradient, diagonal = np.zeros((total, total)), np.zeros(total), np.zeros(total)
    found[:poses, :poses] = whole[:, :POSE, :, :POSE].reshape(poses, poses)
    gradient[:poses], diagonal[:poses] = right[:, :POSE].ravel(), sizes[:, :POSE].ravel()
    if more:
        mixed = np.einsum("cpdm,dl->cplm", whole[:, :POSE, :, POSE:], members)
        found[:poses, poses:] = mixed.reshape(poses, kinds * more)
        found[poses:, :poses] = found[:poses, poses:].T
        both = np.einsum("cndm,dl->cnlm", whole[:, POSE:, :, POSE:], members)
        both = np.einsum("cnlm,ck->knlm", both, members)
        found[poses:, poses:] = both.reshape(kinds * more, kinds * more)
        gradient[poses:] = (members.T @ right[:, POSE:]).ravel()
        diagonal[poses:] = (members.T @ sizes[:, POSE:]).ravel()
    return found, gradient, diagonal
