"""Gaussian splats and their gradients, against NumPy in float64."""

from typing import Any

import numpy as np
import pytest

import cvkern
from cvkern._runtime import runtime
from cvkern.kernels.codes.splats import CULLED, TILE, Splats
from tests.radiance.fields.splat_cases import BENT, STRAIGHT, Case, Run

# Sums over at most 60 splats with some 10 roundings of 2^-24 each, of numbers up to 3.
CLOSE = 2e-5


def gradient(case, stop=1e-4):
    run = Run(runtime(), case)
    run.forward(stop)
    return run.backward()


def differs_by(case, found, per_group=14, stop=1e-4):
    """Compare gradients with central differences of the reference, some of each array."""
    rng, step, slopes = np.random.default_rng(1), 1e-6, case.bends()
    for group, gradients in enumerate(found):
        touched = np.argwhere(gradients != 0)
        chosen = touched[rng.permutation(len(touched))[:per_group]]
        for index in map(tuple, chosen):
            ends = []
            for e in (step, -step):
                splats = [a.copy() for a in case.splats]
                splats[group][index] += e
                ends.append(case.loss(splats, stop, slopes))
            wanted = (ends[0] - ends[1]) / (2 * step)
            name = f"{Splats._fields[group]}{index}"
            # Float32 rounds the sum that is left behind a splat, of up to some 30 pixels.
            assert gradients[index] == pytest.approx(wanted, rel=3e-4, abs=3e-5), name


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("lens", [STRAIGHT, BENT], ids=["straight", "bent"])
def test_pictures(lens, degree):
    case = Case(lens=lens, degree=degree)
    seen = Run(runtime(), case).forward()
    for found, wanted in zip(seen, case.truth(), strict=True):
        np.testing.assert_allclose(found, wanted, atol=CLOSE)
    assert seen[1].max() > 0.9


@pytest.mark.parametrize("shape", [(60, 41, 35), (700, 100, 50), (5, 1, 1), (40, 16, 32)])
def test_both_sets_give_the_same_bits_on_the_cpu(shape):
    results = []
    for backend in ("warp", "taichi"):
        with cvkern.use(backend=backend):
            run = Run(runtime(), Case(*shape))
            seen = run.forward()
            results.append([*run.read(run.screen), *run.read(run.lists), *seen, *run.backward()])
    for one, other in zip(*results, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.usefixtures("backend")
def test_lists_have_the_splats_of_tiles_front_to_back():
    case = Case(300, 70, 50)
    case.splats[0][100:200] = case.splats[0][99]  # all at one depth
    run = Run(runtime(), case)
    (_, boxes, keys), lists = run.read(run.screen), run.read(run.lists)
    order, ranks, ends, entries, sources, ranges = lists
    np.testing.assert_array_equal(ranks[order], np.arange(len(order)))
    np.testing.assert_array_equal(order, np.argsort(keys, kind="stable"))
    counts = (boxes[:, 2] * boxes[:, 3])[order]
    np.testing.assert_array_equal(ends, counts.cumsum())
    assert (counts > 0).sum() == (keys != CULLED).sum()
    wanted = [[] for _ in ranges[1:]]
    source = 0
    for n in order:
        left, top, columns, rows = boxes[n]
        for row in range(top, top + rows):
            for column in range(left, left + columns):
                wanted[row * -(-case.width // TILE) + column].append((n, source))
                source += 1
    np.testing.assert_array_equal(np.diff(ranges), list(map(len, wanted)))
    flat = np.array([pair for tile in wanted for pair in tile])
    np.testing.assert_array_equal(np.stack((entries, sources), 1), flat)


@pytest.mark.usefixtures("backend")
def test_entries_without_room_are_those_of_the_farthest():
    case = Case(200)
    full, less = Run(runtime(), case), Run(runtime(), case, room=100)
    ends = less.read(less.lists)[2]
    assert ends[-1] > 100
    sources = less.read(less.lists)[4]
    np.testing.assert_array_equal(np.sort(sources), np.arange(100))
    less.forward()
    far = less.read(less.lists)[0][ends > 110]
    assert not less.backward()[0][far].any()
    full.forward()
    assert full.backward()[0][far].any()


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("large", [1, 2, 3])
def test_sums_beyond_int32_list_no_more_entries(large):
    """Splats that cover 2^31 tiles and more: sums of int32 turn negative, then positive again."""
    rt, run = runtime(), Run(runtime(), Case(3 + large, 70, 50), room=9)
    boxes = np.tile(np.array([0, 0, 2**16 - 2, 2**15], np.int32), (3 + large, 1))
    boxes[0], boxes[-2:] = [1, 0, 2, 1], [0, 0, 1, 1]
    rt.write(run.screen.boxes, boxes)
    rt.write(run.screen.keys, np.arange(3 + large, dtype=np.int32))
    run.kernels.lists.sort(run.screen, *run.lists[:3])
    sums = (boxes[:, 2:].astype(np.int64).prod(axis=1)).cumsum()
    np.testing.assert_array_equal(run.read(run.lists)[2], np.minimum(sums, 2**31 - 1))
    run.kernels.lists.fill(run.screen, 5, run.lists)
    sources = run.read(run.lists)[4]
    np.testing.assert_array_equal(np.sort(sources), np.arange(9))


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize(
    ("lens", "degree"), [(STRAIGHT, 3), (BENT, 3), (STRAIGHT, 0)], ids=["straight", "bent", "plain"]
)
def test_gradients_are_central_differences(lens, degree):
    case = Case(lens=lens, degree=degree)
    found = gradient(case)
    assert len(np.unique(np.argwhere(found[0])[:, 0])) > 30
    differs_by(case, found)


@pytest.mark.usefixtures("backend")
def test_gradients_of_opaque_splats_stop_at_the_largest_opacity():
    case = Case(30, lens=STRAIGHT)
    case.splats[3][:] = 7.0  # an opacity of 0.999
    case.splats[2][:] = -2.5
    found = gradient(case)
    differs_by(case, found)
    case = Case(1, 5, 5, [40, 40, 2, 2, 0, 0, 0, 0, 0])
    case.splats[0][:], case.splats[3][:], case.splats[2][:] = 0, 9.0, 0.5
    d = gradient(case)
    assert not d[3].any()
    assert d[4].any()


@pytest.mark.usefixtures("backend")
def test_gradients_where_rays_end():
    case = Case(120, lens=STRAIGHT)
    case.splats[3][:] += 2.0
    some, all_of_them = gradient(case, 0.5), gradient(case)
    assert np.count_nonzero(some[0]) < np.count_nonzero(all_of_them[0])
    differs_by(case, some, stop=0.5)


@pytest.mark.usefixtures("backend")
def test_gradients_of_black_channels_and_beside_the_image():
    case = Case(lens=STRAIGHT)
    case.splats[4][:30] = -4.0  # negative before the limit
    case.splats[5][:30] = 0.0
    beside = np.outer(np.linspace(1, 1.5, 15), case.pose[:, :3] @ (0.85, 0.1, 1.0))
    case.splats[0][30:45] = case.pose[:, 3] + beside
    case.splats[2][30:45] = -1.0
    found = gradient(case)
    assert not found[4][:30].any()
    assert found[0][30:45].any(axis=1).all()  # they reach into the image
    differs_by(case, found)


@pytest.mark.usefixtures("backend")
def test_the_backward_pass_is_the_transpose_of_the_forward_pass():
    """Colours act linearly where none is below 0: <g, J v> = <J^T g, v>."""
    case = Case(seed=5)
    case.splats[4][:] += 8.0
    case.gradients[1][:] = 0
    found, rng = gradient(case), np.random.default_rng(3)
    change = [0.1 * rng.normal(size=a.shape) for a in case.splats[4:]]
    moved = [*case.splats[:4], case.splats[4] + change[0], case.splats[5] + change[1]]
    forward = case.loss(moved) - case.loss(case.splats)
    backward = sum((f * c).sum() for f, c in zip(found[4:], change, strict=True))
    assert backward == pytest.approx(forward, rel=1e-4)


def splat(**changes: Any):
    """Return a case of one splat in the middle of the image, changed."""
    case = Case(1, 33, 33, [40, 40, 16, 16, 0, 0, 0, 0, 0])
    plain: Any = dict(zip(Splats._fields, case.splats, strict=True))
    plain["means"][:], plain["opacities"][:], plain["scales"][:] = 0, 1.0, -2.0
    for name, value in changes.items():
        plain[name][:] = value
    return case


BEHIND = 2 * Case().pose[:, 3]
UNSEEN = {
    "behind": {"means": BEHIND},
    "at the camera": {"means": Case().pose[:, 3]},
    "beside": {"means": (90.0, 0, 0)},
    "no opacity": {"opacities": -40.0},
    "no turn": {"turns": 0.0},
    "too large": {"scales": 60.0},
}


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("changes", UNSEEN.values(), ids=UNSEEN)
def test_splats_that_are_not_seen(changes):
    case = splat(**changes)
    run = Run(runtime(), case)
    _, boxes, keys = run.read(run.screen)
    assert not boxes.any()
    assert keys[0] == CULLED
    assert not any(a.any() for a in run.forward())
    assert not any(a.any() for a in run.backward())


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize(
    "changes",
    [{}, {"scales": -30.0}, {"scales": (-30.0, -30.0, -1.0)}, {"scales": (-1.0, -1.0, -30.0)},
     {"turns": 1e-3}, {"scales": 1.5}],
    ids=["one", "point", "needle", "disc", "short", "large"],
)  # fmt: skip
def test_one_splat(changes):
    """A point is as wide as a pixel; a needle and a disc have no volume."""
    case = splat(**changes)
    run = Run(runtime(), case)
    seen = run.forward()
    for found, wanted in zip(seen, case.truth(), strict=True):
        np.testing.assert_allclose(found, wanted, atol=CLOSE)
    assert seen[1].max() == pytest.approx(1 / (1 + np.exp(-1)), rel=0.05)
    differs_by(case, run.backward(), per_group=3)


@pytest.mark.usefixtures("backend")
def test_splats_of_one_depth_are_drawn_by_their_numbers():
    case = Case(2, 33, 33, [40, 40, 16, 16, 0, 0, 0, 0, 0], degree=0)
    case.splats[0][:], case.splats[2][:], case.splats[3][:] = 0, -2.0, 3.0
    case.splats[4][:] = [[1.7, -1.7, -1.7], [-1.7, -1.7, 1.7]]
    red = Run(runtime(), case).forward()[0]
    assert red[16 * 33 + 16, 0] > 10 * red[16 * 33 + 16, 2]
    case.splats[4] = case.splats[4][::-1]
    np.testing.assert_allclose(Run(runtime(), case).forward()[0], red[:, ::-1], atol=1e-6)


@pytest.mark.usefixtures("gpu")
def test_a_gpu_computes_the_same(backend):
    """It fuses products and sums, and has exponentials of its own: 2^-22 of each number."""
    case, results = Case(3000, 200, 150), []
    for device in ("cpu", "cuda", "cuda"):
        with cvkern.use(backend=backend, device=device):
            run = Run(runtime(), case)
            results.append([*run.forward(), *run.backward()])
    for host, one, again in zip(*results, strict=True):
        np.testing.assert_array_equal(one, again)
        assert np.abs(one - host).sum() < 1e-5 * np.abs(host).sum()
