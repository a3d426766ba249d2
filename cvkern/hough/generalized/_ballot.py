"""The inputs of the votes of the generalised Hough transform, and the poses with most votes."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import (
    MAX_ELEMENTS,
    as_numbers,
    check_image,
    check_integer,
    check_number,
    refuse_masks,
)
from cvkern._runtime import Runtime, refuse_capture, runtime
from cvkern.edges.masks import find_edges, photograph_options
from cvkern.hough.generalized._poses import Scene, apart, strongest
from cvkern.kernels.codes.hough import (
    DIRECTION_FACTOR,
    DIRECTIONS,
    SCALE_ONE,
    TILE,
    TURN_ONE,
    VECTOR_ONE,
    Cells,
    Entries,
    Slices,
    Voters,
)

EDGE_OPTIONS = ("sigma", "low_threshold", "high_threshold", "use_quantiles")
CELLS = (1, 2, 4, 8, 16)
LEAST_TOLERANCE, MOST_TOLERANCE = math.radians(0.5), math.radians(3)
SPARE = 16  # points that a kernel may read beyond the last
MAX_VOTES = 2**16 - 1  # the most that a cell of an accumulator holds
LEAST_SCALE, MOST_SCALE = 1 / 16, 16.0
MANY = 2048  # largest number of tiles that become candidates
WEAKER = 4  # largest ratio of the best candidate's votes to another candidate's
MAX_ANGLE = 7.0  # radians: largest direction of a gradient, a little more than a turn
MAX_SLICES = 2**18  # pairs of rotation and scale per launch, which limits the grid of blocks


class Ballot(NamedTuple):
    """The entries, rotations and scales that vote, as the integers that kernels take."""

    vectors: np.ndarray
    directions: np.ndarray
    rotations: np.ndarray
    turns: np.ndarray
    scales: np.ndarray
    tolerance: int
    shift: int

    def cells(self, height: int, width: int) -> tuple[int, int]:
        """Return rows and columns of an accumulator."""
        return ((height - 1) >> self.shift) + 1, ((width - 1) >> self.shift) + 1

    def tiles(self, height: int, width: int) -> tuple[int, int]:
        """Return rows and columns of tiles; kernels report one peak per tile."""
        rows, columns = self.cells(height, width)
        return -(-rows // TILE), -(-columns // TILE)

    def batch(self, height: int, width: int, most: int) -> tuple[int, int]:
        """Return how many rotations and how many scales fit into `most` bytes at a time."""
        rows, columns = self.cells(height, width)
        each = 4 * (rows * columns + math.prod(self.tiles(height, width)))
        if each > most:
            raise ValueError(
                f"max_bytes must be at least {each}, for one rotation and scale, got {most}"
            )
        slices = min(most // each, MAX_ELEMENTS // (rows * columns), MAX_SLICES)
        scales = min(slices, len(self.scales))
        return min(slices // scales, len(self.turns)), scales

    def entries(self, rt: Runtime) -> Entries:
        """Return the kernel arrays of the entries."""
        angles = rt.send("shapes.angles", self.directions)
        return Entries(rt.send("shapes.vectors", self.vectors), angles)

    def slices(self, rt: Runtime, turns: slice, scales: slice) -> Slices:
        """Return the kernel arrays of some rotations and scales."""
        return Slices(
            rt.send("shapes.turns", self.turns[turns]),
            rt.send("shapes.scales", self.scales[scales]),
        )


def ballot_of(
    vectors: np.ndarray,
    orientation: np.ndarray,
    rotations: Any,
    scales: Any,
    tolerance: Any,
    cell: int,
    max_entries: int,
) -> Ballot:
    """Check the options of the votes, and convert them to integers."""
    angles = _check_rotations(rotations)
    sizes = _check_scales(scales)
    cell = check_integer(cell, "cell", CELLS[0], CELLS[-1])
    if cell not in CELLS:
        raise ValueError(f"cell must be one of {CELLS}, got {cell}")
    number = min(check_integer(max_entries, "max_entries", 1, 2**20), MAX_VOTES // cell**2)
    if tolerance is None:
        tolerance = min(max(_step(angles) / 2, LEAST_TOLERANCE), MOST_TOLERANCE)
    tolerance = check_number(tolerance, "orientation_tolerance", low=0)
    count = len(vectors)
    chosen = np.arange(min(number, count)) * count // min(number, count)
    turns = np.column_stack(
        (_code(angles), np.rint(np.cos(angles) * TURN_ONE), np.rint(np.sin(angles) * TURN_ONE))
    )
    return Ballot(
        np.rint(vectors[chosen].astype(float) * VECTOR_ONE).astype(np.int32),
        _code(orientation[chosen].astype(float)).astype(np.int32),
        angles,
        turns.astype(np.int32),
        np.rint(sizes * SCALE_ONE).astype(np.int32),
        min(round(tolerance * DIRECTIONS / (2 * math.pi)), DIRECTIONS // 2 - 1),
        cell.bit_length() - 1,
    )


def candidates(
    rt: Runtime, scene: Scene, ballot: Ballot, batch: tuple[int, int], most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the poses with most votes, (N, 4) float64, and their votes."""
    height, width = scene.shape
    tiles = ballot.tiles(height, width)
    if not len(scene.points):
        return np.empty((0, 4)), np.empty(0)
    found: list[tuple[np.ndarray, ...]] = []  # key, rotation, scale, row and column of tiles
    voters, entries = voters_of(rt, scene), ballot.entries(rt)
    cells = Cells(height, width, ballot.shift)
    for r in range(0, len(ballot.turns), batch[0]):
        for s in range(0, len(ballot.scales), batch[1]):
            slices = ballot.slices(rt, np.s_[r : r + batch[0]], np.s_[s : s + batch[1]])
            shape = (slices.turns.shape[0], slices.scales.shape[0], *tiles)
            keys = rt.scratch("shapes.keys", shape, np.int32)
            rt.hough.generalized.votes.search(
                voters, entries, slices, ballot.tolerance, cells, keys
            )
            host = rt.to_numpy(keys).reshape(-1)
            best = strongest(host, MANY)
            turn, scale, down, across = np.unravel_index(best, shape)
            found.append((host[best], r + turn, s + scale, down, across))
    key, turn, scale, down, across = (np.concatenate(a) for a in zip(*found, strict=True))
    votes, place = key // TILE**2, TILE**2 - 1 - key % TILE**2
    # Order ties by slice, so that the result does not depend on the batches.
    order = np.lexsort((across, down, scale, turn, -key))[:MANY]
    order = order[votes[order] >= max(int(votes.max()) // WEAKER, 1)]
    # The corner that four cells share, in pixels with integer centres.
    side = 1 << ballot.shift
    every = np.column_stack((
        (down * TILE + place // TILE + 1) * side - 0.5,
        (across * TILE + place % TILE + 1) * side - 0.5,
        ballot.rotations[turn],
        ballot.scales[scale] / SCALE_ONE,
    ))[order]  # fmt: skip
    # Keep one of several poses that would converge to the same place.
    reach = 0.1 * float(np.hypot(*(ballot.vectors / VECTOR_ONE).T).max())
    near = max(2.5 * side, reach)
    kept = apart(every, most, near, max(1.5 * _step(ballot.rotations), math.radians(5)), 1.08)
    return every[kept], votes[order[kept]]


def scene_of(image: Any, orientation: Any, options: tuple, name: str) -> Scene:
    """Return the edge points of an image, or of a mask with orientation.

    `cvkern.scale` passes a scene that it gathered from tiles.
    """
    if isinstance(image, Scene):
        return image
    refuse_capture("points that the host counts")
    rt = runtime(image, orientation)
    shape = (int(image.shape[0]), int(image.shape[1]))
    dy: Any = None
    dx: Any = None
    angles: Any = None
    if orientation is None:
        mask = rt.scratch("shapes.mask", shape, bool)
        dy, dx = find_edges(rt, image, photograph_options(image, *options), mask)
    else:
        refuse_masks(**dict(zip(EDGE_OPTIONS, options, strict=True)))
        orientation = check_image(orientation, name="orientation")
        if len(image.shape) != 2:
            raise ValueError(
                f"{name} must be a mask (H, W) with orientation, got shape {tuple(image.shape)}"
            )
        if tuple(orientation.shape) != shape:
            raise ValueError(
                f"orientation must have the shape of the {name}, {shape}, "
                f"got {tuple(orientation.shape)}"
            )
        mask, angles = rt.adopt(image, bool), rt.adopt(orientation)
    starts = rt.scratch("shapes.starts", (shape[0] + 1,), np.int32)
    rt.hough.points.count(mask, starts)
    count = int(rt.to_numpy(starts)[-1])
    if not count:
        return Scene(np.empty((0, 2), np.int32), np.empty(0, np.int32), shape)
    points = rt.scratch("shapes.points", (count, 2), np.int32)
    rt.hough.points.gather(mask, starts, points)
    host = rt.to_numpy(points).copy()
    if angles is None:
        codes = rt.scratch("shapes.codes", (count,), np.int32)
        rt.hough.generalized.votes.code_directions(points, dy, dx, codes)
        return Scene(host, rt.to_numpy(codes).copy(), shape)
    at = rt.to_numpy(angles)[tuple(host.T)]
    if not (np.abs(at) <= 7).all():
        wrong = at[~(np.abs(at) <= 7)][0]
        raise ValueError(f"orientation must be in [-7, 7] where the mask is set, got {wrong:g}")
    turned = np.floor(at * np.float32(DIRECTION_FACTOR) + np.float32(0.5))
    return Scene(host, turned.astype(np.int32) & (DIRECTIONS - 1), shape)


def voters_of(rt: Runtime, scene: Scene) -> Voters:
    """Return the points sorted by direction, listed twice, and where each direction starts.

    They are listed twice so that a window of directions that crosses the end is contiguous.
    """
    order = np.argsort(scene.codes.astype(np.uint16), kind="stable")
    count = len(order)
    points = np.zeros((2, 2 * count + SPARE), np.int32)
    points[:, :count] = points[:, count : 2 * count] = scene.points[order].T
    numbers = np.bincount(scene.codes, minlength=DIRECTIONS)
    starts = np.zeros(2 * DIRECTIONS + 1, np.int32)
    np.cumsum(np.concatenate((numbers, numbers)), out=starts[1:])
    return Voters(rt.send("shapes.sorted", points), rt.send("shapes.places", starts))


def _code(angles: np.ndarray) -> np.ndarray:
    """Return the nearest direction code of each angle."""
    return np.floor(angles * (DIRECTIONS / (2 * math.pi)) + 0.5).astype(np.int64) % DIRECTIONS


def _step(angles: np.ndarray) -> float:
    """Return the smallest step between neighbouring angles on the circle; a turn for one angle."""
    around = np.sort(np.mod(angles, 2 * math.pi))
    steps = np.diff(np.concatenate((around, around[:1] + 2 * math.pi)))
    return float(steps[steps > 1e-9].min(initial=2 * math.pi))


def _check_rotations(rotations: Any) -> np.ndarray:
    if rotations is None:
        return np.zeros(1)
    if isinstance(rotations, (int, np.integer)) and not isinstance(rotations, bool):
        count = check_integer(rotations, "rotations", 1, DIRECTIONS)
        return np.arange(count) * (2 * math.pi / count)
    return _check_sequence(rotations, "rotations", -100.0, 100.0)


def _check_scales(scales: Any) -> np.ndarray:
    if scales is None:
        return np.ones(1)
    return _check_sequence(scales, "scales", LEAST_SCALE, MOST_SCALE)


def _check_sequence(values: Any, name: str, low: float, high: float) -> np.ndarray:
    array = as_numbers(values, name)
    if array.ndim != 1 or not array.size:
        raise ValueError(f"{name} must be 1-D and not empty, got shape {array.shape}")
    wrong = array[~((array >= low) & (array <= high))]
    if len(wrong):
        raise ValueError(f"{name} must be in [{low:g}, {high:g}], got {wrong[0]:g}")
    return array
