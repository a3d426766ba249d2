"""The primitives of generalized Hough transforms against NumPy."""

import numpy as np
import pytest

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
from tests.filters import reference_gradients as gradients_reference
from tests.primitives import F32, I32, waves


def shape_votes(height, width):
    """Points sorted by direction, twice over, their starts; a table; rotations and scales."""
    rng = np.random.default_rng(3)
    count = 700
    codes = np.sort(rng.integers(0, DIRECTIONS, count))
    points = np.zeros((2, 2 * count + 16), I32)
    points[:, : 2 * count] = np.tile(rng.integers(0, (height, width), (count, 2)).T, 2)
    numbers = np.bincount(codes, minlength=DIRECTIONS)
    starts = np.concatenate(([0], np.cumsum(np.tile(numbers, 2)))).astype(I32)
    vectors = rng.integers(-30 * VECTOR_ONE, 30 * VECTOR_ONE, (90, 2)).astype(I32)
    directions = rng.integers(0, DIRECTIONS, 90).astype(I32)
    turns = np.array([0, 4000, 16000])
    angles = turns * (2 * np.pi / DIRECTIONS)
    turns = np.stack((turns, TURN_ONE * np.cos(angles), TURN_ONE * np.sin(angles)), 1).round()
    scales = np.array([0.8, 1.3]) * SCALE_ONE
    slices = Slices(turns.astype(I32), scales.astype(I32))
    return Voters(points, starts), Entries(vectors, directions), slices


@pytest.mark.parametrize("shift", [0, 3])
def test_accumulate_and_search(kernels, shift):
    """The integers that the kernels state, pair by pair."""
    height, width, tolerance = 53, 67, 60
    given = shape_votes(height, width)
    points, starts, vectors, directions, turns, scales = (
        a.astype(np.int64) for pair in given for a in pair
    )
    cells = ((height - 1) >> shift) + 1, ((width - 1) >> shift) + 1
    want = np.zeros((3, 2, *cells), np.int64)
    for r, (turn, cosine, sine) in enumerate(turns):
        for (y, x), direction in zip(vectors, directions, strict=True):
            low = (direction + turn - tolerance) % DIRECTIONS
            some = points[:, starts[low] : starts[low + 2 * tolerance + 1]]
            turned = np.array([y * cosine + x * sine, x * cosine - y * sine])
            turned = np.floor(turned / 2**24 + 0.5).astype(np.int64)
            for s, scale in enumerate(scales):
                at = some + np.floor(turned * scale / 2**15 + 0.5).astype(np.int64)[:, None]
                at = at[:, (at >= 0).all(0) & (at[0] < height) & (at[1] < width)] >> shift
                np.add.at(want[r, s], tuple(at), 1)
    options = tolerance, Cells(height, width, shift)
    got = kernels("hough.generalized.votes.accumulate", *given, *options, out=[(want.shape, I32)])
    np.testing.assert_array_equal(got, want)
    assert want.sum() > 500
    padded = np.pad(want, ((0, 0), (0, 0), (0, 1), (0, 1)))
    sums = padded[..., 1:, 1:] + padded[..., :-1, 1:] + padded[..., 1:, :-1] + padded[..., :-1, :-1]
    tiles = -(-cells[0] // TILE), -(-cells[1] // TILE)
    keys = kernels("hough.generalized.votes.search", *given, *options, out=[((3, 2, *tiles), I32)])
    for r, s, down, across in np.ndindex(*keys.shape):
        tile = sums[r, s, down * TILE : (down + 1) * TILE, across * TILE : (across + 1) * TILE]
        i, j = np.unravel_index(tile.argmax(), tile.shape)  # the first of equal ones
        place = TILE * TILE - 1 - (i * TILE + j)
        assert keys[r, s, down, across] == tile.max() * TILE * TILE + place


def test_code_directions(kernels):
    dy, dx = waves(31, 40)
    points = np.argwhere(dy > 0).astype(I32)
    got = kernels(
        "hough.generalized.votes.code_directions", points, dy, dx, out=[((len(points),), I32)]
    )
    angles = gradients_reference.orientation(dy, dx)[tuple(points.T)]
    turned = np.floor(angles * F32(DIRECTION_FACTOR) + F32(0.5)).astype(I32)
    np.testing.assert_array_equal(got, turned % DIRECTIONS)
