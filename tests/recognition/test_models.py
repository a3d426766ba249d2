"""Shape models find objects made of an alphabet of parts, at any scale and half hidden."""

from functools import cache

import numpy as np
import pytest
import scipy.ndimage as ndi
import skimage.transform

import cvkern
from tests.recognition import reference_recognition as reference
from tests.recognition.alphabet import clutter, overlap, put, thing, things

SHAPE = (120, 160)


@pytest.fixture(scope="module")
def model():
    with cvkern.use(backend="warp"):
        return cvkern.ShapeModel(200, patch=12, mirror=False).fit(
            things(6), negatives=[clutter((90, 130), seed) for seed in range(8)]
        )


def found_one(found, box, least):
    """Tell whether the strongest is the object, and no other is half as strong."""
    return overlap(found.boxes[0], box) > least and (found.scores[1:] < 0.5 * found.scores[0]).all()


def test_places(backend, model):
    for seed in range(4):
        image = clutter(SHAPE, 100 + seed)
        row, column = np.random.default_rng(seed).integers(0, (88, 112))
        box = put(image, thing(noise=0.05, seed=90 + seed), row, column)
        found = model.detect(image, scales=[1.0])
        assert found_one(found, box, 0.75)
        middle = np.array([box[0] + box[2], box[1] + box[3]]) / 2 - 0.5
        # The grid has a point every four pixels.
        assert np.abs(found.centers[0] - middle).max() <= 2.5
        assert found.scales[0] == 1
        np.testing.assert_allclose(found.boxes[0, :2] + (16, 24), found.centers[0] + 0.5)


@pytest.mark.parametrize("scale", [0.75, 1.0, 1.3])
def test_scales(backend, model, scale):
    what = skimage.transform.rescale(thing(), scale, anti_aliasing=True).astype(np.float32)
    image = clutter(SHAPE, 7)
    box = put(image, what, 40, 50)
    found = model.detect(image)
    assert found_one(found, box, 0.6)
    assert abs(np.log2(found.scales[0] / scale)) < 0.2


@pytest.mark.parametrize("side", [slice(0, 24), slice(24, 48)])
def test_half_hidden(backend, model, side):
    what = thing(noise=0.05, seed=5)
    what[:, side] = 0.5
    image = clutter(SHAPE, 9)
    box = put(image, what, 33, 61)
    assert found_one(model.detect(image, scales=[1.0]), box, 0.7)


def test_two_beside_each_other_and_none(backend, model):
    image = clutter(SHAPE, 11)
    boxes = [put(image, thing(), 30, column) for column in (20, 70)]
    found = model.detect(image, scales=[1.0])
    for box in boxes:
        assert max(overlap(box, b) for b in found.boxes[:2]) > 0.75
    assert (np.diff(found.scores) <= 0).all()
    assert found.scores[-1] >= model.threshold
    nothing = model.detect(clutter(SHAPE, 12), scales=[1.0])
    assert (nothing.scores < 0.2 * found.scores[1]).all()
    again = model.detect(image, scales=[1.0], threshold=found.scores[0] + 1)
    assert again.boxes.shape == (0, 4)


@pytest.mark.parametrize("value", [0.0, 0.5])
def test_one_colour_and_tiny(backend, model, value):
    for shape in ((90, 90), (11, 50), (1, 1)):
        found = model.detect(np.full(shape, value))
        assert [a.shape for a in found] == [(0, 4), (0,), (0, 2), (0,)]
        assert all(a.dtype == np.float32 for a in found)


def test_votes_to_look_at(backend, model):
    image = clutter(SHAPE, 13)
    put(image, thing(), 44, 56)
    small, own = model.votes(image, scales=[1.0, 0.8])
    assert own.shape == (30, 40)
    assert small.shape == (38, 51)  # cells of 51 sixteenths of a pixel
    # The middle of the object is at (59.5, 79.5); its cells have most votes.
    smooth = ndi.uniform_filter(own.astype(float), 3)
    best = np.unravel_index(smooth.argmax(), own.shape)
    assert np.abs(np.array(best) - (14.5, 19.5)).max() < 1.6
    assert own.sum() <= 2**16 * 30 * 40
    assert model.words.shape[1:] == (12, 12)
    (none,) = model.votes(np.zeros((40, 50)), scales=[1.0])
    assert none.shape == (10, 13)
    assert not none.any()


def test_weights_of_a_word_add_up_to_its_share(model):
    fitted = model._fitted
    sums = np.add.reduceat(fitted.entries[:, 3], fitted.starts[:-1])
    assert (sums <= 2**16).all()
    assert (fitted.entries[:, 3] >= 0).all()
    with cvkern.use(backend="warp"):
        alone = cvkern.ShapeModel(60, patch=12).fit(things(2))._fitted
    assert alone is not None
    sums = np.add.reduceat(alone.entries[:, 3], alone.starts[:-1])
    counts = np.diff(alone.starts)
    assert (2**16 - sums <= counts).all()  # each weight was rounded down
    assert (sums <= 2**16).all()


SHORTEST: dict[bytes, list[int]] = {}


def test_description_is_the_shortest_that_greed_finds(backend, model, monkeypatch):
    from cvkern.recognition import choices

    image = clutter(SHAPE, 11)
    put(image, thing(), 30, 20)
    put(image, thing(), 42, 60)
    seen = {}

    def spy(judge, modes, evidence, starts, least, found):
        explain(judge, modes, evidence, starts, least, found)
        on_host = [np.array(judge.rt.to_numpy(a)) for a in (*judge.patches, judge.weights)]
        modes, evidence, chosen = (np.array(judge.rt.to_numpy(a)) for a in (modes, evidence, found))
        there = modes[:, 3] > 0
        seen.update(host=on_host, modes=modes[there], evidence=evidence[there], least=least)
        seen.update(chosen=chosen[1 : chosen[0, 0] + 1])

    explain = choices.explain
    monkeypatch.setattr("cvkern.recognition.search.explain", spy)
    model.detect(image, scales=[1.0], threshold=-8.0)
    places, _, levels, matches, weights = seen["host"]
    given = places, matches, levels[:, 0], weights, model._settings.frame
    order = np.lexsort((*seen["modes"][:, 2::-1].T, -seen["evidence"]))
    order = order[seen["evidence"][order] >= seen["least"]]
    assert len(order) > 10
    modes = seen["modes"][order].tolist()
    # Both sets see the same, bit for bit: the reference, which takes seconds, runs once.
    arrays = (*seen["host"], seen["modes"][order], seen["evidence"][order])
    key = b"".join(array.tobytes() for array in arrays)
    if key not in SHORTEST:
        shared = cache(lambda i, j: reference.evidence(*given, modes[i], modes[j]))
        evidence = seen["evidence"][order].tolist()
        SHORTEST[key] = reference.shortest(evidence, shared, seen["least"])
    want = SHORTEST[key]
    assert seen["chosen"][:, :3].tolist() == [modes[i][:3] for i in want]
    assert len(want) > 2


def test_modes_climb_to_more_evidence(backend, model, monkeypatch):
    """Each goes to the best of nine places, by 4 pixels and then by 2, as plain Python goes."""
    from cvkern.recognition import hypotheses

    seen = {}

    def spy(judge, modes, evidence, least):
        found = climb(judge, modes, evidence, least)
        on_host = [np.array(judge.rt.to_numpy(a)) for a in (*judge.patches, judge.weights)]
        begin, known, *end = (np.array(judge.rt.to_numpy(a)) for a in (modes, evidence, *found))
        begin = begin[(begin[:, 3] > 0) & (known >= least)]
        seen.update(host=on_host, modes=begin, found=[a[end[0][:, 3] > 0] for a in end])
        return found

    climb = hypotheses.climb
    monkeypatch.setattr("cvkern.recognition.search.climb", spy)
    image = clutter((70, 90), 11)
    put(image, thing(), 21, 23)
    model.detect(image, scales=[0.7], threshold=-2.0)
    places, _, levels, matches, weights = seen["host"]
    frame = model._settings.frame
    want = {}
    for mode in seen["modes"].tolist():
        y, x, z, _ = mode
        for step in (64, 32):
            apart = int(np.floor(step * reference.factor(z) / 2**16 + 0.5))
            near = [(y + a * apart, x + b * apart) for a in (0, -1, 1) for b in (0, -1, 1)]
            sums = [
                reference.evidence(places, matches, levels[:, 0], weights, frame, (*place, z))
                for place in near
            ]
            best = int(np.argmax(sums))
            y, x = near[best]
        want[y, x, z] = sums[best]
    modes, evidence = seen["found"]
    found = {tuple(m[:3]): e for m, e in zip(modes.tolist(), evidence.tolist(), strict=True)}
    assert found == want
    assert len(modes) == len(want) > 3
    assert {tuple(m[:3]) for m in seen["modes"].tolist()} - set(want)


@pytest.mark.parametrize("points", ["harris", "dog"])
def test_points_of_interest(backend, points):
    model = cvkern.ShapeModel(60, patch=12, points=points, step=2, mirror=False).fit(
        things(4), negatives=[clutter((90, 130), seed) for seed in range(4)]
    )
    image = clutter(SHAPE, 21)
    box = put(image, thing(), 50, 70)
    found = model.detect(image, scales=[1.0])
    assert len(found.boxes)
    assert overlap(found.boxes[0], box) > 0.6


def test_sets_learn_and_find_the_same():
    """Models, and what they find, are equal in every bit."""
    image = clutter(SHAPE, 31)
    put(image, thing(), 50, 70)
    answers = []
    for name in ("warp", "taichi"):
        with cvkern.use(backend=name):
            model = cvkern.ShapeModel(30, patch=8).fit(things(2), negatives=[clutter((60, 90), 1)])
            assert model._fitted is not None
            answers.append((*model._fitted, *model.detect(image, threshold=-3.0)))
    assert len(answers[0][-1]) > 0
    for a, b in zip(*answers, strict=True):
        np.testing.assert_array_equal(a, b)


def test_boxes_and_masks_of_larger_pictures(backend):
    image = clutter(SHAPE, 41)
    boxes = [put(image, thing(noise=0.03, seed=s), r, c) for s, r, c in ((1, 10, 20), (2, 70, 90))]
    model = cvkern.ShapeModel(40, patch=12, mirror=False).fit(
        [image, thing()], [boxes, [(0, 0, 32, 48)]]
    )
    assert model.box == (32, 48)
    other = clutter(SHAPE, 42)
    box = put(other, thing(), 44, 52)
    found = model.detect(other, scales=[1.0])
    assert overlap(found.boxes[0], box) > 0.7
    smaller = cvkern.ShapeModel(40, patch=8, size=32, mirror=False).fit([image], [boxes])
    assert smaller.box == (21, 32)
