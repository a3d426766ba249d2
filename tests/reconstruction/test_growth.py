"""Reconstruction from given places of points, without images: noise, outliers, hard scenes."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cvkern.reconstruction import _averaging, _course, _growth, _pairs, _planes, _tracks
from cvkern.reconstruction._adjustment import lens_row
from cvkern.reconstruction._photographs import Keypoints, Lenses
from cvkern.scale.journals import Journal
from tests.reconstruction import scenes


def heap(poses, points, noise=0.3, outliers=0.0, seed=0, lens=None):
    """Return keypoints of views, in an own order each, and the point of each."""
    rng = np.random.default_rng(seed)
    seen = scenes.project(poses, points, lens or scenes.camera())
    found, names = [], []
    for places in seen:
        inside = np.isfinite(places[:, 0]) & (np.abs(places - 300) < 500).all(axis=1)
        name = rng.permutation(np.flatnonzero(inside))
        at = places[name] + rng.normal(0, noise, (len(name), 2))
        wrong = rng.random(len(name)) < outliers
        at[wrong] += rng.uniform(-80, 80, (int(wrong.sum()), 2))
        color = np.zeros((len(name), 3), np.uint8)
        found.append(Keypoints(at[:, ::-1].copy(), np.arange(len(name)), None, name, color))
        names.append(name)
    return found, names


def matched(names):
    """Return the true matches of all pairs."""
    pairs, places = [], []
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            _, a, b = np.intersect1d(names[i], names[j], return_indices=True)
            if len(a) >= 15:
                pairs.append((i, j))
                places.append(np.stack((a, b), axis=1))
    return _pairs.Matched(np.array(pairs).reshape(-1, 2), places)


def grown(found, matches, told=True, fixed=False, focal=scenes.FOCAL):
    """Return the model that grows from keypoints and matches."""
    row = lens_row(scenes.camera(focal))
    lenses = Lenses(row[None], np.zeros(len(found), int), np.array([told]), fixed)
    say = lambda *given: None  # noqa: E731
    for chosen in _pairs.with_focals(found, matches, lenses, 0):
        pairs = _pairs.consistent(_pairs.verify(found, matches, chosen, 0), len(found))
        pairs = _pairs.agreeing(pairs, len(found))
        growth = _growth.Growth(_tracks.find_tracks(found, pairs), pairs, chosen, 0)
        if growth.begin():
            growth.grow(say)
            for _ in range(_growth.ROUNDS):
                if growth.settle(last=True):
                    break
            return growth
    return None


def placed(growth):
    turns = growth.rotations.transpose(0, 2, 1)
    eyes = -np.einsum("nij,nj->ni", turns, growth.translations)
    return np.concatenate((turns, eyes[:, :, None]), axis=2)[growth.placed]


CLOUD = np.random.default_rng(5).uniform(-1, 1, (150, 3))


@pytest.mark.parametrize(
    ("noise", "outliers", "told"), [(0.3, 0.0, False), (0.3, 0.3, True), (1.0, 0.1, True)]
)
def test_cameras_are_found(noise, outliers, told):
    poses = scenes.ring(7)
    found, names = heap(poses, CLOUD, noise, outliers)
    growth = grown(found, matched(names), told)
    assert growth is not None
    assert growth.placed.all()
    centres, turns = scenes.errors(placed(growth), poses)
    # About 100 points with errors of noise / 600 each, seven cameras; a lens that is not known
    # leaves a multiple of that.
    assert centres < 0.01 + 0.01 * noise
    assert turns < 0.6
    assert abs(growth.rows[0, 0] / scenes.FOCAL - 1) < 0.03


def test_equal_runs():
    found, names = heap(scenes.ring(5), CLOUD, 0.5, 0.1)
    one, two = (grown(found, matched(names)) for _ in range(2))
    assert one is not None
    assert two is not None
    np.testing.assert_array_equal(one.points, two.points)
    np.testing.assert_array_equal(one.rotations, two.rotations)


def test_a_camera_that_only_turns_gives_nothing():
    poses = scenes.ring(5)
    poses[:, :, 3] = poses[0, :, 3]
    found, names = heap(poses, 3 * CLOUD, 0.3)
    assert len(matched(names).pairs) >= 4
    assert grown(found, matched(names)) is None


@pytest.mark.parametrize("swapped", [False, True])
def test_a_plane_before_known_cameras(swapped, monkeypatch):
    """Two motions explain two photographs of a plane; further photographs decide."""
    verify = _pairs.verify

    def other_first(*given):
        pairs = verify(*given)
        assert sum(np.isfinite(p.other).all() for p in pairs) > 5
        return [
            p._replace(
                rotation=p.other[:, :3], translation=p.other[:, 3],
                other=np.column_stack((p.rotation, p.translation)),
            ) if np.isfinite(p.other).all() else p
            for p in pairs
        ]  # fmt: skip

    if swapped:
        monkeypatch.setattr(_pairs, "verify", other_first)
    flat = CLOUD * (1, 1, 0)
    poses = scenes.ring(6)
    found, names = heap(poses, flat, 0.2)
    growth = grown(found, matched(names), fixed=True)
    assert growth is not None
    assert growth.placed.all()
    centres, turns = scenes.errors(placed(growth), poses)
    assert centres < 0.02
    assert turns < 0.5


def test_motions_before_a_plane():
    rng = np.random.default_rng(0)
    turns = Rotation.from_rotvec(rng.normal(0, 0.3, (6, 3))).as_matrix()
    for turn in turns:
        normal = np.append(rng.normal(0, 0.4, 2), 1)
        shift = rng.normal(size=3)
        homography = rng.uniform(-3, 3) * (turn + np.outer(shift, normal) / 4)
        rays = rng.uniform(-0.3, 0.3, (20, 2))
        motions = _planes.motions_of(homography, rays)
        unit = shift / np.linalg.norm(shift)
        off = [np.abs(r - turn).max() + np.abs(t - unit).max() for r, t in motions]
        assert 1 <= len(motions) <= 2
        assert min(off) < 1e-6
        # Each of them gives the homography, with a plane of its own.
        flat = np.column_stack((rays, np.ones(20)))
        seen = flat @ homography.T
        for r, t in motions:
            moved = flat @ r.T
            # The ray, the moved ray and the shift lie in a plane.
            volume = (np.cross(moved, seen) @ t) / np.linalg.norm(seen, axis=1)
            np.testing.assert_allclose(volume, 0, atol=1e-8)
    assert _planes.motions_of(turns[0], np.zeros((3, 2))) == []


def test_turns_of_all_photographs_from_those_of_pairs():
    rng = np.random.default_rng(1)
    count = 15
    true = Rotation.from_rotvec(rng.normal(0, 2, (count, 3))).as_matrix()
    ends = np.stack(np.triu_indices(count, 1), axis=1)
    ends = ends[((ends < 10).all(axis=1) | (ends >= 10).all(axis=1)) & (ends != 14).all(axis=1)]
    noise = Rotation.from_rotvec(rng.normal(0, 0.01, (len(ends), 3))).as_matrix()
    turns = noise @ true[ends[:, 1]] @ true[ends[:, 0]].transpose(0, 2, 1)
    wrong = (rng.random(len(ends)) < 0.3) & (ends < 10).all(axis=1)
    turns[wrong] = Rotation.from_rotvec(rng.normal(0, 2, (int(wrong.sum()), 3))).as_matrix()
    found = _averaging.average_turns(count, ends, turns, rng.uniform(15, 99, len(ends)))
    assert np.isnan(found.rotations[14]).all()
    for group in (np.arange(10), np.arange(10, 14)):
        between = true[group].transpose(0, 2, 1) @ found.rotations[group]
        # One turn of the world is free; the others differ by the noise, 0.017 a pair.
        assert _averaging.angles_between(between, between[0]).max() < 0.04
    assert (found.off[wrong] > 0.3).all()
    assert (found.off[~wrong] < 0.1).all()


def test_a_repeated_facade():
    """Windows that look alike join photographs of different places; these places stay apart."""
    rng = np.random.default_rng(3)
    window = rng.uniform((0, -1, -0.1), (0.8, 1, 0.3), (25, 3))
    windows = np.concatenate([window + np.array((n, 0, 0)) for n in range(10)])
    points = np.concatenate((windows, rng.uniform((0, -1, -0.3), (10, 1, 0.3), (150, 3))))
    eyes = np.column_stack((np.arange(1.2, 9, 0.7), rng.uniform(-0.1, 0.1, 12), np.full(12, -3.0)))
    poses = np.concatenate((np.tile(np.eye(3), (12, 1, 1)), eyes[:, :, None]), axis=2)
    found, names = heap(poses, points, 0.2)
    shown = [np.abs(points[n, 0] - eye[0]) < 1.4 for n, eye in zip(names, eyes, strict=True)]
    names = [
        np.where(s, n, -1 - i * 1000 - n) for i, (n, s) in enumerate(zip(names, shown, strict=True))
    ]
    true = matched(names)
    pairs, places = true.pairs.tolist(), list(true.places)
    for i in range(12):
        for j in range(i + 1, 12):
            # Photographs of different places: the windows in the middle of both seem to be one.
            if eyes[j, 0] - eyes[i, 0] > 2.9:
                middle = [25 * int(eyes[k, 0]) + np.arange(25) for k in (i, j)]
                at = [
                    np.flatnonzero(names[k] == p)[0]
                    for k, w in zip((i, j), middle, strict=True)
                    for p in w
                ]
                pairs.append([i, j])
                places.append(np.array(at).reshape(2, 25).T)
    assert len(pairs) > len(true.pairs) + 20
    growth = grown(found, _pairs.Matched(np.array(pairs), places), fixed=True)
    assert growth is not None
    assert growth.placed.all()
    centres, turns = scenes.errors(placed(growth), poses)
    assert centres < 0.02
    assert turns < 0.5


@pytest.mark.parametrize("every", [False, True])
def test_of_two_scenes_the_one_with_most_photographs_is_first(every, monkeypatch):
    """The smaller one has more matches, and is begun with."""
    one, names_one = heap(scenes.ring(5), CLOUD[:90])
    other, names_other = heap(scenes.ring(3, seed=1), CLOUD[::-1], seed=1)
    names = [*names_one, *(n + 1000 for n in names_other)]
    matches = matched(names)
    assert max(matches.pairs[np.argsort([len(p) for p in matches.places])[-1]]) > 4
    monkeypatch.setattr(_course, "_keypoints", lambda *given: [*one, *other])
    monkeypatch.setattr(_course, "_matches", lambda *given: matches)
    options = _course.Options(100, "all", 1, every, 0)
    say: Any = lambda *given: None  # noqa: E731
    nothing: Any = None
    course = _course.Course(nothing, options, Journal(None, {}), say)
    lenses = Lenses(lens_row(scenes.camera())[None], np.zeros(8, int), np.array([True]), False)
    largest, smaller = _course.find_models(course, nothing, lenses)
    assert largest.placed.tolist() == [True] * 5 + [False] * 3
    assert smaller.placed.tolist() == [False] * 5 + [True] * 3
    for growth, poses in ((largest, scenes.ring(5)), (smaller, scenes.ring(3, seed=1))):
        assert scenes.errors(placed(growth), poses)[0] < 0.02


def test_a_photograph_of_something_else_and_a_duplicate():
    """The duplicate has no parallax to its twin, and finds its place by the others."""
    poses = scenes.ring(5)[[0, 1, 1, 2, 3, 4]]
    found, names = heap(poses, CLOUD)
    strange = heap(scenes.ring(1), np.random.default_rng(9).uniform(-1, 1, (150, 3)))
    growth = grown([*found, *strange[0]], matched([*names, strange[1][0] + 1000]))
    assert growth is not None
    assert growth.placed.tolist() == [True] * 6 + [False]
    centres, _ = scenes.errors(placed(growth), poses)
    assert centres < 0.02


def test_pairs_that_contradict_all_others_are_left_out():
    """A repeated facade: photographs 0 and 5 seem to see the same from the same side."""
    rng = np.random.default_rng(2)
    turns = scenes.ring(6)[:, :, :3].transpose(0, 2, 1)
    pairs = [
        SimpleNamespace(
            first=i, second=j, flat=0.5, rotation=turns[j] @ turns[i].T, number=rng.integers(9)
        )
        for i in range(6)
        for j in range(i + 1, 6)
    ]
    wrong = next(p for p in pairs if (p.first, p.second) == (0, 5))
    wrong.rotation = np.eye(3)
    kept = _pairs.consistent(pairs, 6)  # pyright: ignore[reportArgumentType]
    assert kept == [p for p in pairs if p is not wrong]


def test_a_plane_keeps_its_motion_if_neither_agrees_with_the_others():
    """Of a wall's two motions neither may be right: the other one is taken only if it fits."""
    turns = scenes.ring(4)[:, :, :3].transpose(0, 2, 1)
    between = lambda i, j: turns[j] @ turns[i].T  # noqa: E731
    places, shift = np.zeros((20, 2), int), np.array([1.0, 0, 0])
    pairs = [
        _pairs.Pair(i, j, places, 0.5, between(i, j), shift, np.full((3, 4), np.nan))
        for i, j in ((0, 1), (1, 2), (2, 3), (0, 2))
    ]
    for off, right in ((0.02, True), (0.6, False)):
        other = np.column_stack((between(1, 3) @ turned(off), shift))
        wall = _pairs.Pair(1, 3, places, 0.99, between(1, 3) @ turned(1.0), shift, other)
        (found,) = [p for p in _pairs.agreeing([*pairs, wall], 4) if p.flat > 0.9]
        want = other[:, :3] if right else wall.rotation
        np.testing.assert_array_equal(found.rotation, want)


def turned(angle):
    return Rotation.from_rotvec([0, 0, angle]).as_matrix()


def test_tracks_never_have_a_photograph_twice():
    def keypoints(count):
        at = np.arange(2.0 * count).reshape(-1, 2)
        return Keypoints(at, np.arange(count), None, at[:, 0], np.zeros((count, 3), np.uint8))

    def pair(i, j, places):
        places = np.array(places)
        return _pairs.Pair(i, j, places, 0.0, np.eye(3), np.ones(3), np.full((3, 4), np.nan))

    found = [keypoints(3), keypoints(3), keypoints(2)]
    # 0:0 - 1:0 - 2:0 - 0:1 would join two places of photograph 0: its weakest join is refused.
    pairs = [
        pair(0, 1, [(0, 0), (2, 2), (1, 1)]),
        pair(1, 2, [(0, 0), (2, 1)]),
        pair(0, 2, [(1, 0)]),
    ]
    tracks = _tracks.find_tracks(found, pairs)
    key = tracks.track * 10 + tracks.view
    assert len(np.unique(key)) == len(key)
    groups = {
        tuple(
            (int(v), int(w[0] // 2))
            for v, w in zip(tracks.view[own], tracks.where[own], strict=True)
        )
        for own in (tracks.track == t for t in range(tracks.total))
    }
    assert groups == {((0, 0), (1, 0), (2, 0)), ((0, 1), (1, 1)), ((0, 2), (1, 2), (2, 1))}
