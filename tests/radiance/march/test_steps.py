"""Marching: the samples of a ray in the occupied cells of space, on every set and device."""

import importlib
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.warp._launch import BLOCK, launch
from tests.primitives import Primitives
from tests.radiance import reference_radiance as reference

F32, I32, U32 = np.float32, np.int32, np.uint32
STEP = np.array([7], I32)


class Space(NamedTuple):
    levels: int
    cells: int
    far: float
    finest: float
    cone: float
    unbounded: bool


SPACES = {
    "cube": Space(1, 16, 1e9, 0.011, 0.0, False),
    "near and far": Space(1, 16, 2.2, 0.011, 0.0, False),
    "unbounded": Space(3, 8, 1e9, 0.02, 1 / 64, True),
    "cells that are no power of 2": Space(4, 12, 5.0, 0.05, 0.0, False),
    "blocks that are skipped": Space(3, 48, 1e9, 0.01, 1 / 256, True),
}


@pytest.fixture(params=SPACES)
def space(request):
    return SPACES[request.param]


def bundle(rays, seed=0):
    """Return rays from inside and outside, some along the axes, some that miss."""
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-2, 2, (rays, 3))
    towards = rng.uniform(-1, 1, (rays, 3)) - origins
    towards[: rays // 8] *= [1, 0, 1]
    towards[: rays // 16] *= [0, 1, 1]
    origins[: rays // 16] *= 0.4
    origins[-4:] *= 20
    towards[-4:] = origins[-4:]  # away from everything
    directions = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    return origins.astype(F32), directions.astype(F32)


def pack(occupied):
    return np.packbits(occupied, bitorder="little").view(U32)


def march(kernels, origins, directions, occupied, space, *, near=0.05, most=10**6, jittered=True,
          active=None, room=30000, seed=5):  # fmt: skip
    """Return `active` as the march leaves it, spans, total, positions, distances, rays."""
    levels, cells, far, finest, cone, unbounded = space
    rays = len(origins)
    active = np.array([rays if active is None else active], I32)
    return kernels(
        "radiance.march.steps.march_rays",
        codes.Space(pack(occupied), levels, cells, unbounded),
        codes.March(near, far, finest, cone, most, jittered, seed, STEP),
        out=[
            codes.Rays(origins, directions, active),
            ((rays, 2), I32),
            ((1,), I32),
            codes.Samples(((room, 3), F32), ((room, 2), F32), ((room,), I32)),
        ],
    )[2:]


def blobs(levels, cells, share, seed=1):
    """Return which cells are occupied: such a share, but none in many of the blocks."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((levels * cells**3 // 64, 64)) < share
    occupied[rng.random(len(occupied)) < 0.4] = False
    return occupied.ravel()


@pytest.mark.parametrize("jittered", [False, True])
@pytest.mark.parametrize("share", [0.1, 0.6])
def test_march_finds_what_asking_at_every_step_does(kernels, space, share, jittered):
    levels, cells, far, finest, cone, unbounded = space
    origins, directions = bundle(64)
    occupied = blobs(levels, cells, share)
    active, spans, total, positions, distances, rays = march(
        kernels, origins, directions, occupied, space, jittered=jittered
    )
    assert total[0] == spans[:, 1].sum() <= len(positions)
    assert active[0] == 64
    np.testing.assert_array_equal(spans[:, 0], np.cumsum(spans[:, 1]) - spans[:, 1])
    np.testing.assert_array_equal(rays[: total[0]], np.repeat(np.arange(64), spans[:, 1]))
    assert (spans[:, 1] == 0).any()
    jitter = np.full(64, 0.5)
    if jittered:
        jitter = reference.random_unit(5, 7, np.arange(64), 4)
    given = occupied, levels, cells, 0.05, far, finest, cone, jitter
    want = reference.march(origins, directions, *given)
    np.testing.assert_array_equal(spans[:, 1], [len(t) for t in want])
    np.testing.assert_array_equal(distances[: total[0], 0], np.concatenate(want))

    found = slice(0, total[0])
    t, step = distances[found].T
    np.testing.assert_array_equal(step, np.maximum(F32(finest), F32(cone) * t))
    points = origins[rays[found]] + t[:, None].astype(float) * directions[rays[found]]
    # Rounded a few times at the size of the point; contraction lessens it.
    np.testing.assert_allclose(
        positions[found], reference.in_cube(points, unbounded), rtol=0, atol=2**-20
    )
    assert (positions[total[0] :] == 77).all()


def through_corners():
    """Return rays through corners of cubes, along sides and diagonals, and a step's length."""
    finest = 2.0**-5
    towards = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]) - 1.0
    corners = np.array(list(np.ndindex(3, 3, 3))) - 1.0
    corners, towards = np.repeat(corners, len(towards), 0), np.tile(towards, (len(corners), 1))
    sides = [4.0, 2.0, 1.0, 0.5, 1 / 3]
    directions = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    # Half a step behind the nearest, and as they are: the first step is half of one.
    origins = np.concatenate([side * corners - (2 + finest / 2) * directions for side in sides])
    origins = np.concatenate([origins, origins + (finest / 2) * np.tile(directions, (5, 1))])
    return origins.astype(F32), np.tile(directions, (10, 1)).astype(F32), finest


@cache
def met_through_corners(cells, cone):
    """Return the samples of those rays in three levels of cells, half of which are occupied."""
    origins, directions, finest = through_corners()
    occupied = blobs(3, cells, 0.5)
    return reference.march(origins, directions, occupied, 3, cells, 0.0, 5.0, finest, cone, 0.5)


@pytest.mark.parametrize("cone", [0.0, 1 / 64])
@pytest.mark.parametrize("cells", [8, 12, 16])
def test_march_along_the_sides_of_cells(kernels, cells, cone):
    """Places exactly on sides, edges and corners, where a ray enters an inner cube among them."""
    origins, directions, finest = through_corners()
    occupied = blobs(3, cells, 0.5)
    space = Space(3, cells, 5.0, finest, cone, True)
    _, spans, total, _, distances, _ = march(
        kernels, origins, directions, occupied, space, near=0.0, jittered=False, room=700000
    )
    assert total[0] == spans[:, 1].sum() > 1e5
    want = met_through_corners(cells, cone)
    np.testing.assert_array_equal(spans[:, 1], [len(t) for t in want])
    np.testing.assert_array_equal(distances[: total[0], 0], np.concatenate(want))


@pytest.mark.parametrize("cone", [0.0, 1e-4])
def test_march_takes_thousands_of_samples_of_a_ray(kernels, cone):
    origins, directions = bundle(8)
    space = Space(1, 16, 1e9, 1e-3, cone, False)
    _, spans, total, _, distances, _ = march(
        kernels, origins, directions, np.ones(16**3, bool), space, jittered=False
    )
    assert spans[:, 1].max() > 1024
    assert (spans[-4:, 1] == 0).all()  # those that miss
    given = np.ones(16**3, bool), 1, 16, 0.05, 1e9, 1e-3, cone, 0.5
    want = reference.march(origins, directions, *given)
    np.testing.assert_array_equal(distances[: total[0], 0], np.concatenate(want))


def test_march_no_rays(kernels):
    origins, directions = bundle(16)
    occupied = np.ones(16**3, bool)
    _, spans, total, *rest = march(kernels, origins, directions, occupied, SPACES["cube"], active=0)
    assert total[0] == 0
    assert (spans == 0).all()
    assert all((array == 77).all() for array in rest)


def test_march_takes_so_many_samples_and_rays_at_most(kernels):
    space = SPACES["cube"]
    origins, directions = bundle(64)
    occupied = blobs(1, 16, 0.5)
    _, spans, _, _, distances, _ = march(kernels, origins, directions, occupied, space)
    left, few, total, _, nearest, _ = march(
        kernels, origins, directions, occupied, space, most=20, active=40
    )
    np.testing.assert_array_equal(few[:40, 1], np.minimum(spans[:40, 1], 20))
    assert (few[40:, 1] == 0).all()
    assert left[0] == 40
    assert total[0] == few[:, 1].sum()
    for (begin, _), (at, count) in zip(spans[:40], few[:40], strict=True):
        np.testing.assert_array_equal(nearest[at : at + count], distances[begin : begin + count])


@pytest.mark.parametrize("part", [0.0, 0.4, 1.0])
def test_march_drops_rays_that_do_not_fit(kernels, part):
    space = SPACES["cube"]
    origins, directions = bundle(600)
    occupied = np.ones(16**3, bool)
    room = 120000
    all_active, all_spans, all_total, _, whole, _ = march(
        kernels, origins, directions, occupied, space, room=room
    )
    assert (all_active[0], all_total[0]) == (600, all_spans[:, 1].sum())
    assert all_total[0] < room
    room = int(part * all_total[0])
    active, spans, total, _, distances, rays = march(
        kernels, origins, directions, occupied, space, room=max(room, 1)
    )
    ends = np.cumsum(all_spans[:, 1])
    fits = ends <= max(room, 1)
    np.testing.assert_array_equal(spans[:, 1], np.where(fits, all_spans[:, 1], 0))
    np.testing.assert_array_equal(spans[fits, 0], all_spans[fits, 0])
    assert active[0] == fits.sum()  # the others must not count as rays that see nothing
    assert total[0] == spans[:, 1].sum()
    np.testing.assert_array_equal(distances[: total[0]], whole[: total[0]])
    assert (rays[total[0] :] == 77).all()


def test_march_places_more_samples_than_32_bits_count(kernels):
    """A batch may have 2^24 rays of 2^10 samples: the sum must not come out small again."""
    if kernels.name == "taichi" and kernels.device != "cpu":
        pytest.skip("the kernel of the CPU, which takes arrays as the test has them")
    rays, each, room = 2**22, 2**10, 2**20
    counts = np.full((rays, 2), [77, each], I32)
    arrays = [kernels._adopt(a) for a in (counts, np.full(1, 77, I32), np.full(1, rays, I32))]
    if kernels.name == "taichi":
        importlib.import_module("cvkern.kernels.taichi.radiance.march.steps")._place(room, *arrays)
    else:
        name = "steps" if kernels.device == "cpu" else "_steps_cuda"
        place = importlib.import_module(f"cvkern.kernels.warp.radiance.march.{name}").place
        threads = 1 if kernels.device == "cpu" else BLOCK
        launch(place, threads, [room], arrays)
    spans, total, active = map(kernels._package.to_numpy, arrays)
    fits = room // each
    assert (total[0], active[0]) == (room, fits)
    np.testing.assert_array_equal(spans[:fits, 0], each * np.arange(fits))
    assert (spans[:fits, 1] == each).all()
    assert (spans[fits:] == [room, 0]).all()


def test_march_through_nothing(kernels):
    origins, directions = bundle(16)
    active, spans, total, *_ = march(
        kernels, origins, directions, np.zeros(16**3, bool), SPACES["cube"]
    )
    assert (active[0], total[0]) == (16, 0)
    assert (spans == 0).all()


def test_march_meets_the_same_cells_everywhere(all_kernels, space):
    origins, directions = bundle(500, seed=3)
    occupied = blobs(space.levels, space.cells, 0.3)
    here = Primitives("warp", "cpu")
    first, *others = (
        march(kernels, origins, directions, occupied, space, room=60000)
        for kernels in (here, *all_kernels)
    )
    assert first[2][0] > 10000
    for found in others:
        for name, a, b in zip(
            ("active", "spans", "total", "positions", "distances", "rays"),
            first,
            found,
            strict=True,
        ):
            if name == "positions":  # rounded otherwise, but of the same samples
                np.testing.assert_allclose(b, a, rtol=0, atol=2**-21)
            else:
                np.testing.assert_array_equal(b, a)
