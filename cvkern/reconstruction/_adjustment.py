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
    JOINED,
    POSE,
    Blocks,
    Condensed,
    Eliminated,
    Loss,
    Scenery,
    Sightings,
    Slopes,
)
from cvkern.panorama.adjustment import turn
from cvkern.reconstruction._solving import solve

STEPS = 50
ENOUGH = 1e-7  # the steps end when the cost falls by less than this share of it
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-4, 1e-8, 1e8
# Standard deviations of k1 and k2, and of the principal point about the middle of the image, in
# longest sides. Errors of neighbouring places are alike, so that many count as one.
BEND_SPREAD, MIDDLE_SPREAD, ALIKE = 0.05, 0.015, 30.0
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


def cost_of(joined: np.ndarray, loss: Loss, scale: float) -> float:
    """Return the cost from the joined costs of sightings; see `JOINED`."""
    if loss == Loss.CAUCHY:
        joined = scale * scale * np.log(joined)
    return float(joined.sum()) / 2


def gaps_of(bundle: Bundle) -> np.ndarray:
    """Return projected less seen places (O, 2), pixels; `BEHIND` for points behind a view."""
    return _Equations(runtime(), bundle, Effort()).gaps()


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
    equations.prepare(bundle)
    best, damping = _whole_cost(bundle, equations, effort), FIRST_DAMPING
    for _ in range(effort.steps if len(bundle.seen) else 0):
        equations.linearise()
        before = best
        # The damping is ten times as large in each round.
        while damping <= MOST_DAMPING:
            steps = equations.step(bundle, still, held, damping)
            if steps is not None:
                tried = _moved(bundle, effort.size, *steps)
                equations.move(tried, *steps)
                now = _whole_cost(tried, equations, effort)
                if np.isfinite(now) and now < best:
                    bundle, best = tried, now
                    break
                equations.move_back(bundle)
            damping *= 10
        damping = max(damping / 10, LEAST_DAMPING)
        if before - best <= effort.enough * before:
            break
    return bundle._replace(points=equations.points()), equations.gaps()


def _whole_cost(bundle: Bundle, equations: _Equations, effort: Effort) -> float:
    pull, stiffness = _anchored(bundle, effort)
    anchored = float((pull * pull / np.where(stiffness > 0, stiffness, 1)).sum())
    return equations.cost() + anchored / 2


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


def _moved(bundle: Bundle, size: int, poses: np.ndarray, lenses: np.ndarray) -> Bundle:
    """Return the bundle after steps of poses (C, 6) and lenses (L, K - 6), points as they were."""
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
    )


class _Equations:
    """The equations of a step, where kernels are; points stay there until the end."""

    def __init__(self, rt: Runtime, bundle: Bundle, effort: Effort):
        self.rt, self.effort = rt, effort
        self.kernels = rt.reconstruction.adjustment
        views, count, size = len(bundle.rotations), len(bundle.seen), effort.size
        points = len(bundle.points)
        view, point = bundle.seen.T
        counts = np.bincount(point, minlength=points)
        by_view = np.bincount(view, minlength=views)
        ends = np.stack((view, bundle.lens_of[view], point), axis=1)
        self.sightings = Sightings(
            rt.send("bundle.where", np.ascontiguousarray(bundle.where, np.float64)),
            rt.send("bundle.ends", ends.astype(np.int32)),
            rt.send("bundle.spans", _spans(counts)),
            # Sorting 16 bits takes a tenth of the time.
            rt.send("bundle.order", np.argsort(_narrow(view), kind="stable").astype(np.int32)),
            rt.send("bundle.ranges", _spans(by_view)),
        )
        self._gaps = self._room("gaps", (count, 2))
        self._costs = self._room("costs", (-(-count // JOINED),))
        self.slopes = Slopes(
            self._room("slopes", (count, 2, 3 + size)), self._room("residuals", (count, 2)),
            self._room("weights", (count,)),
        )  # fmt: skip
        self.eliminated = Eliminated(
            self._room("inverses", (points, 6)), self._room("pulls", (points, 3))
        )
        self._places = [
            rt.send("bundle.points", np.ascontiguousarray(bundle.points)),
            self._room("moved", (points, 3)),
        ]
        self._send_views(bundle)

    def _room(self, name: str, shape: tuple[int, ...]) -> Any:
        return self.rt.scratch(f"bundle.{name}", shape, np.float64)

    def _send_views(self, bundle: Bundle) -> None:
        views = np.concatenate((bundle.rotations.reshape(-1, 9), bundle.translations), axis=1)
        self._views = (
            self.rt.send("bundle.views", views),
            self.rt.send("bundle.lenses", np.ascontiguousarray(bundle.lenses)),
        )

    @property
    def _scenery(self) -> Scenery:
        return Scenery(*self._views, self._places[0])

    def points(self) -> np.ndarray:
        """Return the points (P, 3)."""
        return np.array(self.rt.to_numpy(self._places[0]))

    def gaps(self) -> np.ndarray:
        """Return the residuals (O, 2)."""
        if self._gaps.shape[0]:
            self.kernels.measure(self._scenery, self.sightings, self._gaps)
        return np.array(self.rt.to_numpy(self._gaps))

    def cost(self) -> float:
        """Return the cost of the residuals."""
        if not self._gaps.shape[0]:
            return 0.0
        loss, scale = self.effort.loss, self.effort.scale
        self.kernels.measure(self._scenery, self.sightings, self._gaps)
        self.kernels.join_costs(self._gaps, int(loss), scale, self._costs)
        with np.errstate(all="ignore"):  # costs may overflow
            return cost_of(self.rt.to_numpy(self._costs), loss, scale)

    def linearise(self) -> None:
        """Find the derivatives."""
        effort = self.effort
        self.kernels.linearise(
            self._scenery, self.sightings, int(effort.loss), effort.scale, self.slopes
        )

    def prepare(self, bundle: Bundle) -> None:
        """Find which views see the same points, before the first step."""
        from scipy.sparse import csr_matrix

        view, point = bundle.seen.T
        shape = len(bundle.rotations), len(bundle.points)
        seen = csr_matrix((np.ones(len(view), np.float32), (view, point)), shape)
        both = (seen @ seen.T).toarray() > 0
        np.fill_diagonal(both, True)
        self.blocks = np.argwhere(np.triu(both))
        number = np.full(both.shape, -1, np.int32)
        number[self.blocks[:, 0], self.blocks[:, 1]] = np.arange(len(self.blocks))
        rt, size, views = self.rt, self.effort.size, len(both)
        self._sent_blocks = Blocks(
            rt.send("bundle.blocks", self.blocks.astype(np.int32)),
            rt.send("bundle.numbers", number),
        )
        self.condensed = Condensed(
            self._room("system", (len(self.blocks), size, size)),
            self._room("right", (views, size)),
            self._room("sizes", (views, size)),
        )

    def step(
        self, bundle: Bundle, fixed: np.ndarray, held: np.ndarray, damping: float
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Return steps of poses and lenses, or None if the equations have no solution."""
        kernels, rt, size = self.kernels, self.rt, self.effort.size
        kernels.eliminate(self.slopes, self.sightings, damping, self.eliminated)
        kernels.condense(
            self.slopes, self.sightings, self.eliminated, self._sent_blocks, self.condensed
        )
        condensed = Condensed(*(rt.to_numpy(a) for a in self.condensed))
        whole, gradient, diagonal = joined(condensed, self.blocks, bundle)
        pull, stiffness = _anchored(bundle, self.effort)
        more = np.arange(len(gradient) - pull.size, len(gradient))
        gradient[more] += pull.ravel()
        diagonal[more] += stiffness.ravel()
        whole[more, more] += stiffness.ravel()
        still = np.append(np.repeat(fixed, POSE), np.repeat(held, size - POSE))
        free = np.flatnonzero(~still)
        steps = np.zeros(len(still))
        if len(free):
            part = whole if len(free) == len(whole) else whole[np.ix_(free, free)]
            part[np.diag_indices(len(free))] += damping * diagonal[free] + WEAK * (
                1 + diagonal.max()
            )
            found = solve(part, gradient[free]) if np.isfinite(part).all() else None
            if found is None:
                return None
            steps[free] = -found
        views = len(fixed)
        return steps[: views * POSE].reshape(views, POSE), steps[views * POSE :].reshape(
            len(bundle.lenses), size - POSE
        )

    def move(self, tried: Bundle, poses: np.ndarray, lenses: np.ndarray) -> None:
        """Go to views and lenses after steps, and to the points that fit these best."""
        own = np.concatenate((poses, lenses[tried.lens_of]), axis=1)
        self.kernels.substitute(
            self.slopes, self.sightings, self.eliminated,
            self.rt.send("bundle.steps", np.ascontiguousarray(own)), *self._places,
        )  # fmt: skip
        self._places.reverse()
        self._send_views(tried)

    def move_back(self, bundle: Bundle) -> None:
        """Undo a move."""
        self._places.reverse()
        self._send_views(bundle)


def _spans(counts: np.ndarray) -> np.ndarray:
    return np.stack((np.cumsum(counts) - counts, counts), axis=1).astype(np.int32)


def _narrow(view: np.ndarray) -> np.ndarray:
    return view.astype(np.uint16) if view.max(initial=0) < 2**16 else view


def joined(
    condensed: Condensed, blocks: np.ndarray, bundle: Bundle
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the equations of poses, then of lenses: matrix, gradient, and undamped diagonal."""
    system, right, sizes = condensed
    views, kinds, more = len(right), len(bundle.lenses), right.shape[1] - POSE
    lens_of, (c, d) = bundle.lens_of, blocks.T
    poses, lenses = views * POSE, kinds * more
    found = np.zeros((poses + lenses, poses + lenses))
    gradient, diagonal = np.zeros((2, poses + lenses))
    gradient[:poses], diagonal[:poses] = right[:, :POSE].ravel(), sizes[:, :POSE].ravel()
    square = np.zeros((views, POSE, views, POSE))
    square[c, :, d] = system[:, :POSE, :POSE]
    square[d, :, c] = system[:, :POSE, :POSE].transpose(0, 2, 1)  # blocks of one view are symmetric
    found[:poses, :poses] = square.reshape(poses, poses)
    if more:
        apart = np.flatnonzero(c != d)
        turned = system[apart].transpose(0, 2, 1)
        rows, columns = np.concatenate((c, d[apart])), np.concatenate((d, c[apart]))
        whole = np.concatenate((system, turned))
        mixed = np.zeros((views, kinds, POSE, more))
        np.add.at(mixed, (rows, lens_of[columns]), whole[:, :POSE, POSE:])
        both = np.zeros((kinds, kinds, more, more))
        np.add.at(both, (lens_of[rows], lens_of[columns]), whole[:, POSE:, POSE:])
        found[:poses, poses:] = mixed.transpose(0, 2, 1, 3).reshape(poses, lenses)
        found[poses:, :poses] = found[:poses, poses:].T
        found[poses:, poses:] = both.transpose(0, 2, 1, 3).reshape(lenses, lenses)
        for values, place in ((right, gradient), (sizes, diagonal)):
            sums = np.zeros((kinds, more))
            np.add.at(sums, lens_of, values[:, POSE:])
            place[poses:] = sums.ravel()
    return found, gradient, diagonal
