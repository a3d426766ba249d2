"""Where fields are looked at: random numbers, rays of cameras, marching, the occupancy grid."""

import importlib
from typing import NamedTuple

import numpy as np
import pytest
from primitives import Primitives
from reference import radiance as reference

from cvkern.kernels.warp._launch import BLOCK, launch

F32, I32, U8, U32 = np.float32, np.int32, np.uint8, np.uint32
STEP = np.array([7], I32)


# ------------------------------------------------------------------------------ random numbers


def visit(kernels, number, count, cells=8, every=False, unbounded=False, seed=3, step=7, begin=0):
    return kernels(
        "radiance_occupancy.visit", cells, count, every, unbounded, seed, np.array([step], I32),
        begin, out=[((number,), I32), ((number, 3), F32)],
    )  # fmt: skip


@pytest.mark.parametrize("seed", [0, 1, 2**31 - 1, -5])
@pytest.mark.parametrize("step", [0, 1, 10**6])
def test_random_numbers_have_the_bits_of_the_definition(kernels, seed, step):
    begin, number, count = 100, 1000, 2 * 8**3
    numbers, points = visit(kernels, number, count, seed=seed, step=step, begin=begin)
    item = begin + np.arange(number)
    np.testing.assert_array_equal(numbers, reference.random_index(seed, step, item, 8, count))
    want = reference.in_cube(reference.random_points(numbers, 8, seed, step), False)
    # A number, the product with the size of the cell, two sums, each rounded once, within 2.
    np.testing.assert_allclose(points, want, rtol=0, atol=4 * 2**-23)


def test_random_numbers_are_uniform_and_independent(kernels):
    numbers, bins = 2**16, 64
    drawn = [visit(kernels, numbers, bins, seed=s, step=t)[0] for s, t in ((1, 0), (1, 1), (2, 0))]
    pairs = [drawn[0][:-1] * bins + drawn[0][1:]]  # of one item and the next, step, seed
    pairs += [drawn[0] * bins + other for other in drawn[1:]]
    for values, size in [(d, bins) for d in drawn] + [(p, bins * bins) for p in pairs]:
        expected = len(values) / size
        chi2 = ((np.bincount(values, minlength=size) - expected) ** 2 / expected).sum()
        # About normal, of mean size and variance 2 size; the numbers are always the same.
        assert abs(chi2 - size) < 4 * np.sqrt(2 * size)


# ---------------------------------------------------------------------------------------- rays


def cameras(views, seed=0, distorted=True):
    """Return poses and lenses of cameras about the origin, of about 90 degrees."""
    rng = np.random.default_rng(seed)
    turns = np.linalg.qr(rng.normal(size=(views, 3, 3)))[0]
    turns[:, :, 0] *= np.linalg.det(turns)[:, None]
    poses = np.concatenate([turns, rng.normal(size=(views, 3, 1))], 2)
    lenses = np.zeros((views, 9))
    lenses[:, :4] = rng.uniform([9, 10, 7, 5], [10, 11, 8, 6], (views, 4))
    if distorted:
        lenses[:, 4:] = rng.uniform(-1, 1, (views, 5)) * [0.1, 0.02, 0.01, 0.01, 0.005]
    return poses.astype(F32), lenses.astype(F32)


def project(points, pose, lens):
    """Return the (column, row) of points of the world, by OpenCV."""
    cv2 = pytest.importorskip("cv2")
    inverse = np.linalg.inv(np.vstack([pose, [0, 0, 0, 1]]).astype(float))
    matrix = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]], float)
    rotation = cv2.Rodrigues(inverse[:3, :3])[0]
    return cv2.projectPoints(points.astype(float), rotation, inverse[:3, 3], matrix, lens[4:])[0][
        :, 0
    ]


@pytest.mark.parametrize("distorted", [False, True])
def test_view_rays_meet_their_pixels(kernels, distorted):
    width, height, begin = 16, 12, 37
    poses, lenses = cameras(3, distorted=distorted)
    count = width * height - begin
    for view in range(3):
        origins, directions = kernels(
            "radiance_rays.view_rays", poses, lenses, view, width, begin,
            out=[((count, 3), F32)] * 2,
        )  # fmt: skip
        np.testing.assert_array_equal(origins, np.tile(poses[view, :, 3], (count, 1)))
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
        pixels = begin + np.arange(count)
        found = project(origins + 2.0 * directions.astype(float), poses[view], lenses[view])
        want = np.stack([pixels % width, pixels // width], 1)
        # Newton's method ends within the rounding of its terms; a pixel is 0.1 of the focal length.
        np.testing.assert_allclose(found, want, rtol=0, atol=1e-4)


def test_view_rays_of_pixels_that_no_point_is_seen_at(kernels):
    """Behind the fold of a lens Newton's method ends anywhere: rays must have a direction."""
    size = 400
    poses = np.eye(3, 4, dtype=F32)[None]
    middle, focal = size / 2, size / 2.4
    lens = np.array([[focal, focal, middle, middle, -0.35, 0.15, 1e-3, 1e-3, -0.03]], F32)
    rays = [((size * size, 3), F32)] * 2
    _, directions = kernels("radiance_rays.view_rays", poses, lens, 0, size, 0, out=rays)
    # Two sums, a root and a quotient are rounded.
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=0, atol=4 * 2**-23)


@pytest.mark.parametrize("channels", [3, 4])
def test_random_rays_are_those_of_the_pixels_they_show(kernels, channels):
    width, height, views, rays = 16, 12, 3, 3000
    poses, lenses = cameras(views)
    pixels = np.arange(views * width * height)
    images = np.stack([pixels & 255, pixels >> 8, 9 * pixels & 255, 5 * pixels & 255], 1)
    images = images[:, :channels].astype(U8)

    def draw(spread, step=7):
        step = np.array([step], I32)
        given = poses, lenses, images, width, height, spread, 11, step
        out = [((rays, 3), F32), ((rays, 3), F32), ((rays, 4), F32)]
        return kernels("radiance_rays.random_rays", *given, out=out)

    origins, directions, targets = draw(0.0)
    bytes_ = np.round(targets * 255).astype(int)
    pixel = bytes_[:, 0] + 256 * bytes_[:, 1]
    np.testing.assert_array_equal(
        pixel, reference.random_index(11, 7, np.arange(rays), 0, len(pixels))
    )
    np.testing.assert_array_equal(bytes_[:, :channels], images[pixel])
    if channels == 3:
        assert (targets[:, 3] == 1).all()
    for view in range(views):
        own = pixel // (width * height) == view
        assert own.sum() > rays / 6
        out = [((width * height, 3), F32)] * 2
        whole = kernels("radiance_rays.view_rays", poses, lenses, view, width, 0, out=out)
        within = pixel[own] % (width * height)
        np.testing.assert_array_equal(origins[own], whole[0][within])
        np.testing.assert_allclose(directions[own], whole[1][within], rtol=0, atol=1e-6)

    _, spread_out, again = draw(1.0)
    np.testing.assert_array_equal(again, targets)  # the same pixels
    for view in range(views):
        own = pixel // (width * height) == view
        points = origins[own] + 2.0 * spread_out[own].astype(float)
        within = pixel[own] % (width * height)
        off = project(points, poses[view], lenses[view])
        off = off - np.stack([within % width, within // width], 1)
        assert np.abs(off).max() < 0.5 + 1e-4
        # Uniform: of mean 0 and variance 1 / 12, here of about 1000 values.
        np.testing.assert_allclose(off.mean(0), 0, atol=5 * np.sqrt(1 / 12 / own.sum()))
        np.testing.assert_allclose((off**2).mean(0), 1 / 12, rtol=0.2)
    assert (draw(0.0, step=8)[2] != targets).any(1).mean() > 0.9


# -------------------------------------------------------------------------------------- marching


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
        "radiance_march.march_rays", origins, directions, pack(occupied), levels, cells, near, far,
        finest, cone, most, jittered, unbounded, seed, STEP,
        out=[active, ((rays, 2), I32), ((1,), I32), ((room, 3), F32), ((room, 2), F32),
             ((room,), I32)],
    )  # fmt: skip


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
    for ray, (begin, count) in enumerate(spans):
        t = distances[begin : begin + count, 0]
        given = occupied, levels, cells, 0.05, far, finest, cone, jitter[ray]
        want = reference.march(origins[ray], directions[ray], *given)
        np.testing.assert_array_equal(t, want)

    found = slice(0, total[0])
    t, step = distances[found].T
    np.testing.assert_array_equal(step, np.maximum(F32(finest), F32(cone) * t))
    points = origins[rays[found]] + t[:, None].astype(float) * directions[rays[found]]
    # Rounded a few times at the size of the point; contraction lessens it.
    np.testing.assert_allclose(
        positions[found], reference.in_cube(points, unbounded), rtol=0, atol=2**-20
    )
    assert (positions[total[0] :] == 77).all()


@pytest.mark.parametrize("cone", [0.0, 1 / 64])
@pytest.mark.parametrize("cells", [8, 12, 16])
def test_march_along_the_sides_of_cells(kernels, cells, cone):
    """Places exactly on sides, edges and corners, where a ray enters an inner cube among them."""
    levels, finest = 3, 2.0**-5
    towards = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]) - 1.0
    corners = np.array(list(np.ndindex(3, 3, 3))) - 1.0
    corners, towards = np.repeat(corners, len(towards), 0), np.tile(towards, (len(corners), 1))
    sides = [4.0, 2.0, 1.0, 0.5, 1 / 3]
    directions = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    # Half a step behind the nearest, and as they are: the first step is half of one.
    origins = np.concatenate([side * corners - (2 + finest / 2) * directions for side in sides])
    origins = np.concatenate([origins, origins + (finest / 2) * np.tile(directions, (5, 1))])
    origins, directions = origins.astype(F32), np.tile(directions, (10, 1)).astype(F32)
    occupied = blobs(levels, cells, 0.5)
    space = Space(levels, cells, 5.0, finest, cone, True)
    _, spans, total, _, distances, _ = march(
        kernels, origins, directions, occupied, space, near=0.0, jittered=False, room=700000
    )
    assert total[0] == spans[:, 1].sum() > 1e5
    given = occupied, levels, cells, 0.0, 5.0, finest, cone, 0.5
    want = [reference.march(o, d, *given) for o, d in zip(origins, directions, strict=True)]
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
    want = [reference.march(o, d, *given) for o, d in zip(origins, directions, strict=True)]
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
        importlib.import_module("cvkern.kernels.taichi.radiance_march")._place(room, *arrays)
    else:
        name = "radiance_march" if kernels.device == "cpu" else "_radiance_march_blocks"
        place = importlib.import_module(f"cvkern.kernels.warp.{name}").place
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


# ------------------------------------------------------------------------------------- occupancy


@pytest.mark.parametrize("unbounded", [False, True])
def test_visit_every_cell(kernels, unbounded):
    cells, levels = 4, 3
    count = levels * cells**3
    numbers, points = visit(
        kernels, 100, count, cells=cells, every=True, unbounded=unbounded, begin=count - 80
    )
    # Those behind the last are the last again.
    np.testing.assert_array_equal(numbers, np.minimum(count - 80 + np.arange(100), count - 1))
    inside = reference.random_points(numbers, cells, 3, 7)
    level, found = reference.cells_of(inside.astype(F32), levels, cells)
    own = level == numbers // cells**3  # the middle of an outer level is that of an inner one
    assert own.any()
    np.testing.assert_array_equal(found[own], numbers[own])
    np.testing.assert_allclose(
        points, reference.in_cube(inside, unbounded), rtol=0, atol=4 * 2**-21
    )


def test_visit_other_cells_in_the_next_batch(kernels):
    first, second = (visit(kernels, 500, 8**3, begin=begin)[0] for begin in (0, 500))
    assert (first != second).mean() > 0.9
    np.testing.assert_array_equal(visit(kernels, 1000, 8**3)[0], np.concatenate([first, second]))


def test_fade_and_raise(kernels):
    rng = np.random.default_rng(4)
    density = rng.random(300).astype(F32)
    faded = kernels("radiance_occupancy.fade", 0.75, out=[density])
    np.testing.assert_array_equal(faded, density * F32(0.75))
    visited = rng.integers(0, 100, 1000).astype(I32)  # each cell many times
    sigma = rng.random(1000).astype(F32)
    raised = kernels("radiance_occupancy.raise_to", visited, sigma, out=[density])
    want = density.copy()
    np.maximum.at(want, visited, sigma)
    np.testing.assert_array_equal(raised, want)


@pytest.mark.parametrize("least", [0.1, 10.0])
@pytest.mark.parametrize(("count", "parts"), [(64, 1024), (4096, 128), (4128, 100), (2**17, 50)])
def test_mark(kernels, count, parts, least):
    density = np.random.default_rng(5).random(count).astype(F32)
    found, limit, bits = kernels(
        "radiance_occupancy.mark", density, least,
        out=[((parts,), F32), ((1,), F32), ((count // 32,), U32)],
    )  # fmt: skip
    # Sums of up to 4096 numbers below 1, each rounded to 24 digits.
    np.testing.assert_allclose(found.sum(dtype=float), density.sum(dtype=float), rtol=1e-5)
    np.testing.assert_allclose(limit, min(least, density.mean(dtype=float)), rtol=1e-5)
    np.testing.assert_array_equal(bits, pack(density > limit))
