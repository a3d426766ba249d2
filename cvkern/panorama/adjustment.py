"""Bundle adjustment of all images of a panorama: joint least squares by normal equations.

Each image has a matrix P that maps directions, or points of a plane, to its pixels. A match of the
images i and j gives the equation ``x_j = P_j P_i^-1 x_i`` up to scale. A small change of P_j to
``(1 + D) P_j`` moves ``X = P_j P_i^-1 x_i`` by ``D X``. The same change of P_i moves it by
``-P_j P_i^-1 D x_i``. These two are the derivatives of all models. A model is described by the
matrices D that it allows (its generators).

The lens of rotating cameras may bend straight lines: it moves a pixel p to ``p (1 + k |p|^2)``,
with one number k for all images of a panorama. Matches are straightened before they are mapped, and
bent after it.

The origin of pixel coordinates is the middle of an image; their unit is the longest side of all
images.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern.panorama.registration import Link

MOST_POINTS = 200  # largest number of matches of a pair in the adjustment
ENOUGH_POINTS = 10_000  # matches of all pairs together: more take longer, and change little
FEWEST_POINTS = 40  # matches of a pair that are kept in any case
HUBER = 2.0  # pixels of the small images: the cost of larger residuals is linear
STEPS = 40
ENOUGH = 1e-6  # the steps end when the relative decrease of the cost is below this
NEAREST = 1e-4  # least depth of a point in front of a camera
BEHIND = 1e3  # pixels: the residual of a point behind a camera
FOCAL_SPREAD = 0.1  # standard deviation of the logarithms of focal lengths about their mean
BEND_SPREAD = 0.2  # standard deviation of k
BEND_STEP = 1e-6  # difference of k for derivatives
NEWTON = 8  # steps of Newton that straighten a point
STEEPEST = 0.1  # least slope of the lens, in them
FOLD = 1.5  # factor at which a lens of negative k turns back; no solution is beyond
BLOCK = 16  # rows of equations that are eliminated together
ALONE = 250_000  # products that BLAS does without threads
WEAK = 1e-9  # weight of the term that keeps the equations solvable


class Observations(NamedTuple):
    """Matches of L directed pairs, at most m matches for each pair."""

    pairs: np.ndarray
    """Indices of the first and the second image, (L, 2)."""
    points: np.ndarray
    """(L, m, 3): x, y, 1 in the first image."""
    targets: np.ndarray
    """(L, m, 2): x, y in the second image."""
    there: np.ndarray
    """(L, m) bool: true where a match exists."""
    scales: np.ndarray
    """(L,): pixels of the small second image per unit of length."""


def observe(
    links: Sequence[Link],
    middles: np.ndarray,
    unit: float,
    factors: np.ndarray,
    most: int = MOST_POINTS,
) -> Observations:
    """Return the matches of links in both directions; `middles` (N, 2) are in the order x, y."""
    count = 2 * len(links)
    most = min(most, max(FEWEST_POINTS, ENOUGH_POINTS // len(links)))
    longest = max(min(len(link.points0), most) for link in links)
    pairs = np.zeros((count, 2), int)
    points, targets = np.zeros((count, longest, 3)), np.zeros((count, longest, 2))
    there = np.zeros((count, longest), bool)
    points[..., 2] = 1
    for n, link in enumerate(links):
        # The matches are in the order of their scales: take them evenly from the whole list.
        chosen = np.linspace(0, len(link.points0) - 1, min(len(link.points0), most)).astype(int)
        a = (link.points0[chosen] - middles[link.first]) / unit
        b = (link.points1[chosen] - middles[link.second]) / unit
        for way, (i, p, j, q) in enumerate(
            ((link.first, a, link.second, b), (link.second, b, link.first, a))
        ):
            place = 2 * n + way
            pairs[place] = i, j
            points[place, : len(p), :2], targets[place, : len(q)] = p, q
            there[place, : len(p)] = True
    return Observations(pairs, points, targets, there, unit * factors[pairs[:, 1]].mean(axis=1))


def part(seen: Observations, members: np.ndarray) -> Observations:
    """Return the pairs within `members`, (N,) bool."""
    kept = members[seen.pairs].all(axis=1)
    return Observations(*(array[kept] for array in seen))


class Rotations:
    """Cameras that turn about one point: three angles and a focal length each."""

    size = 4

    def __init__(
        self,
        rotations: np.ndarray,
        focals: np.ndarray,
        estimates: np.ndarray | None = None,
        spread: float = FOCAL_SPREAD,
        bend: float = 0.0,
        bends: bool = False,
    ):
        self.rotations, self.focals = rotations, focals
        self.estimates, self.spread = estimates, spread
        self.bend, self.bends = bend, bends

    def with_lens(self) -> Rotations:
        """Return the same cameras with a lens that may bend."""
        return Rotations(self.rotations, self.focals, self.estimates, self.spread, 0.0, True)

    def matrices(self) -> np.ndarray:
        """Return K R, (N, 3, 3)."""
        scale = np.ones((len(self.focals), 3))
        scale[:, :2] = self.focals[:, None]
        return scale[:, :, None] * self.rotations

    def generators(self) -> np.ndarray:
        """Return (N, 4, 3, 3): K [e] K^-1 for the axes e, then the one of the focal length."""
        f = self.focals
        made = np.zeros((len(f), 4, 3, 3))
        made[:, 0, 1, 2], made[:, 0, 2, 1] = -f, 1 / f
        made[:, 1, 0, 2], made[:, 1, 2, 0] = f, -1 / f
        made[:, 2, 0, 1], made[:, 2, 1, 0] = -1, 1
        made[:, 3, 0, 0] = made[:, 3, 1, 1] = 1
        return made

    def prior(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Return cost, gradient and curvature, (4 N + 1,), of the prior on focal lengths and k."""
        logs = np.log(self.focals)
        centre = logs.mean() if self.estimates is None else np.log(self.estimates)
        off = (logs - centre) / self.spread
        gradient, curvature = np.zeros((2, len(logs), 4))
        gradient[:, 3], curvature[:, 3] = off / self.spread, 1 / self.spread**2
        cost = (off @ off + (self.bend / BEND_SPREAD) ** 2) / 2
        return (
            float(cost),
            np.append(gradient, self.bend / BEND_SPREAD**2),
            np.append(curvature, 1 / BEND_SPREAD**2),
        )

    def moved(self, steps: np.ndarray) -> Rotations:
        """Return the cameras after small changes `steps`, (4 N + 1,)."""
        own, bend = steps[:-1].reshape(-1, 4), self.bend + float(steps[-1])
        turned = turn(own[:, :3]) @ self.rotations
        focals = self.focals * np.exp(np.clip(own[:, 3], -0.5, 0.5))
        return Rotations(turned, focals, self.estimates, self.spread, bend, self.bends)


class Planes:
    """Images of one plane: each has a matrix with `size` parameters."""

    bend, bends = 0.0, False

    def __init__(self, given: np.ndarray, size: int):
        self.given, self.size = given, size
        self._basis = plane_generators(size)

    def matrices(self) -> np.ndarray:
        """Return the matrices of the images, (N, 3, 3)."""
        return self.given

    def generators(self) -> np.ndarray:
        """Return the generators, (N, size, 3, 3)."""
        return np.broadcast_to(self._basis, (len(self.given), *self._basis.shape))

    def prior(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Return zeros: all maps are equally likely."""
        nothing = np.zeros(len(self.given) * self.size + 1)
        return 0.0, nothing, nothing

    def moved(self, steps: np.ndarray) -> Planes:
        """Return the images after small changes `steps`, (N size + 1,)."""
        own = steps[:-1].reshape(-1, self.size)
        change = np.eye(3) + np.einsum("np,pij->nij", own, self._basis)
        return Planes(with_unit_determinant(change @ self.given), self.size)


def plane_generators(size: int) -> np.ndarray:
    """Return the generators (size, 3, 3) of similarities (4), affine maps (6), homographies (8)."""
    basis = np.zeros((size, 3, 3))
    basis[0, 0, 2] = basis[1, 1, 2] = 1
    if size == 4:
        basis[2, 0, 1], basis[2, 1, 0] = -1, 1
        basis[3, 0, 0] = basis[3, 1, 1] = 1
        return basis
    for k, place in enumerate(((0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1))[: size - 2]):
        basis[(2 + k, *place)] = 1
    return basis


def with_unit_determinant(matrices: np.ndarray) -> np.ndarray:
    """Scale matrices to the determinant 1."""
    return matrices / np.cbrt(np.linalg.det(matrices))[..., None, None]


def turn(vectors: np.ndarray) -> np.ndarray:
    """Return rotations (N, 3, 3) about vectors (N, 3); the angle is the vector's length."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    axis = vectors / np.maximum(angle[:, 0], 1e-300)
    cross = np.zeros((len(vectors), 3, 3))
    cross[:, (2, 0, 1), (1, 2, 0)] = axis
    cross -= cross.swapaxes(1, 2)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)


def straightened(points: np.ndarray, bend: float) -> np.ndarray:
    """Return the points (..., 2) that the lens moves to the given ones, by Newton's method."""
    squares = (points**2).sum(axis=-1, keepdims=True)
    factor = np.ones_like(squares)
    for _ in range(NEWTON if bend else 0):  # f (1 + k f^2 |q|^2) = 1
        inner = bend * factor**2 * squares
        factor -= (factor * (1 + inner) - 1) / np.maximum(1 + 3 * inner, STEEPEST)
        np.clip(factor, 0, FOLD, out=factor)
    return points * factor


def residuals(seen: Observations, model: Any) -> np.ndarray:
    """Return the residuals (M, 2) of all matches, in pixels of the small images."""
    return _seen_at(seen, model)[0][seen.there]


def medians(seen: Observations, model: Any) -> np.ndarray:
    """Return the median of the residuals of each pair, (L,)."""
    off = np.linalg.norm(_seen_at(seen, model)[0], axis=2)
    ordered = np.sort(np.where(seen.there, off, np.inf), axis=1)
    counts = seen.there.sum(axis=1)
    pair, middle = np.arange(len(counts)), np.stack(((counts - 1) // 2, counts // 2))
    return ordered[pair, middle].mean(axis=0)


def _seen_at(seen: Observations, model: Any, more: float = 0.0) -> tuple[np.ndarray, ...]:
    """Return residuals and their inputs, with a lens that bends by `more`."""
    i, j = seen.pairs.T
    matrices, bend = model.matrices(), model.bend + more
    across = matrices[j] @ np.linalg.inv(matrices)[i]
    points = seen.points
    if bend:
        points = np.concatenate((straightened(points[..., :2], bend), points[..., 2:]), axis=2)
    there = points @ across.swapaxes(1, 2)
    front = there[..., 2] > NEAREST
    depth = np.where(front, there[..., 2], 1.0)
    place = there[..., :2] / depth[..., None]
    bent = place * (1 + bend * (place**2).sum(axis=2, keepdims=True)) if bend else place
    off = (bent - seen.targets) * seen.scales[:, None, None]
    off[~front] = BEHIND
    return off, across, points, there, place, depth, front


def cost(seen: Observations, model: Any, huber: float) -> float:
    """Return Huber's cost of all residuals, and that of the prior."""
    length = np.hypot(*residuals(seen, model).T)
    costs = np.where(length < huber, length**2 / 2, huber * (length - huber / 2))
    return float(costs.sum()) + model.prior()[0]


def adjust(
    seen: Observations, model: Any, fixed: np.ndarray, huber: float, steps: int = STEPS
) -> Any:
    """Minimise the cost from a given model and return the result; keep `fixed` parameters."""
    free = np.flatnonzero(np.append(~fixed.ravel(), model.bends))
    best = now = cost(seen, model, huber)
    damping = 1e-3
    for _ in range(steps):
        normal, gradient = _normal(seen, model, huber)
        normal, gradient = normal[np.ix_(free, free)], gradient[free]
        size = np.diag(normal)
        better = None
        # Each round multiplies the damping by ten or leaves: at most 17 rounds.
        while damping < 1e8:
            damped = normal + np.diag(damping * size + WEAK * (1 + size.max()))
            change = np.zeros(fixed.size + 1)
            try:
                change[free] = -_solved(damped, gradient)
            except np.linalg.LinAlgError:
                damping *= 10
                continue
            tried = model.moved(change)
            now = cost(seen, tried, huber)
            if np.isfinite(now) and now < best:
                better = tried
                damping = max(damping / 10, 1e-9)
                break
            damping *= 10
        if better is None:
            break
        model, before, best = better, best, now
        if before - best <= ENOUGH * before:
            break
    return model


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve positive definite equations by Cholesky's method, in blocks of `BLOCK` rows.

    The blocks are too small for threads of BLAS, which wait long for each other on busy machines:
    a step of 30 cameras took 0.2 or 50 ms.
    """
    matrix, right = matrix.copy(), right.copy()
    ends = [slice(k, k + BLOCK) for k in range(0, len(right), BLOCK)]
    for here in ends:
        rest = slice(here.stop, None)
        inverse = np.linalg.inv(np.linalg.cholesky(matrix[here, here]))
        below = matrix[rest, here] @ inverse.T
        matrix[here, here], matrix[rest, here] = inverse, below
        rows = max(BLOCK, ALONE // (BLOCK * max(1, len(below))))
        for k in range(0, len(below), rows):
            matrix[here.stop + k : here.stop + k + rows, rest] -= below[k : k + rows] @ below.T
        right[here] = inverse @ right[here]
        right[rest] -= below @ right[here]
    for here in reversed(ends):
        rest = slice(here.stop, None)
        right[here] = matrix[here, here].T @ (right[here] - matrix[rest, here].T @ right[rest])
    return right


def _normal(seen: Observations, model: Any, huber: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the normal equations of a step: a square matrix and the gradient, (N p + 1,)."""
    made = model.generators()
    count, size = made.shape[:2]
    off, across, points, there, place, depth, front = _seen_at(seen, model)
    length = np.linalg.norm(off, axis=2)
    weight = np.where(length < huber, 1.0, huber / np.maximum(length, 1e-300))
    weight *= front & seen.there
    i, j = seen.pairs.T
    # Derivatives of X with respect to the parameters of both images, (L, 2 p, 3, m).
    pairs, most = seen.there.shape
    first = (across[:, None] @ made[i]).reshape(pairs, 3 * size, 3) @ -points.swapaxes(1, 2)
    second = made[j].reshape(pairs, 3 * size, 3) @ there.swapaxes(1, 2)
    moves = np.concatenate((first, second), axis=1).reshape(pairs, 2 * size, 3, most)
    slopes = moves[:, :, :2] - moves[:, :, 2:] * place.swapaxes(1, 2)[:, None]
    slopes *= (seen.scales[:, None] / depth)[:, None, None]
    if model.bend:  # the lens: (1 + k |p|^2) 1 + 2 k p p^T
        p = place.swapaxes(1, 2)[:, None]
        inner = (slopes * p).sum(axis=2, keepdims=True)
        slopes = slopes * (1 + model.bend * (p**2).sum(axis=2, keepdims=True))
        slopes += 2 * model.bend * p * inner
    weighed = (slopes * weight[:, None, None]).reshape(pairs, 2 * size, 2 * most)
    slopes = slopes.reshape(pairs, 2 * size, 2 * most)
    squares = weighed @ slopes.swapaxes(1, 2)
    pulls = (weighed @ off.swapaxes(1, 2).reshape(pairs, 2 * most, 1))[..., 0]
    _, prior, curvature = model.prior()
    normal, gradient = np.zeros((count, count, size, size)), np.zeros((count, size))
    for n in range(pairs):
        for a, image in enumerate((i[n], j[n])):
            rows = slice(a * size, (a + 1) * size)
            gradient[image] += pulls[n, rows]
            normal[image, i[n]] += squares[n, rows, :size]
            normal[image, j[n]] += squares[n, rows, size:]
    number = count * size
    whole = np.zeros((number + 1, number + 1))
    whole[:number, :number] = normal.swapaxes(1, 2).reshape(number, number)
    slope = np.append(gradient, 0.0)
    if model.bends:
        ahead, back = (_seen_at(seen, model, step)[0] for step in (BEND_STEP, -BEND_STEP))
        by_bend = ((ahead - back) / (2 * BEND_STEP)).swapaxes(1, 2).reshape(len(i), -1, 1)
        heavy = by_bend[..., 0] * np.tile(weight, 2)
        mixed = (slopes @ (heavy[..., None]))[..., 0]
        column = np.zeros((count, size))
        np.add.at(column, i, mixed[:, :size])
        np.add.at(column, j, mixed[:, size:])
        whole[:number, number] = whole[number, :number] = column.ravel()
        whole[number, number] = float((heavy * by_bend[..., 0]).sum())
        slope[number] = float((heavy * off.swapaxes(1, 2).reshape(len(i), -1)).sum())
    whole[np.diag_indices(number + 1)] += curvature
    return whole, slope + prior
