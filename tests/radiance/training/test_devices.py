"""Training on several devices: sums of gradients, equal parameters, and what is refused."""

import numpy as np
import pytest

import cvkern
from cvkern.radiance import fit, make_scene
from cvkern.radiance.trainer import SHARE, Trainer
from cvkern.radiance.training import _begin
from cvkern.radiance.wild.options import Wild
from tests.radiance.runs import FIELDS, TINY

TAME = Wild(None, None, False, False)
LATER = np.array([1000], np.int32)  # a step at which something may pass in front of photographs
WILD = pytest.mark.parametrize("wild", [
    Wild("affine", None, False, False), Wild("embedding", None, False, False),
    Wild("affine", None, False, True),
], ids=["affine", "embedding", "transient"])  # fmt: skip
GPUS = pytest.param(("cuda:0", "cuda:1"), id="cuda", marks=pytest.mark.skipif(
    "cuda:1" not in cvkern.devices(), reason="needs two GPUs"))  # fmt: skip
PLACES = pytest.mark.parametrize("places", [pytest.param(("cpu", "cpu"), id="cpu"), GPUS])


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=8, test=2, size=24)


def trainers(scene, field, places, wild=TAME):
    made = []
    for place in places:
        with cvkern.use(device=place):
            made.append(_begin(scene, field, None, 3, wild, 0.0, None))
    others = [Trainer(one, scene, "squared", 0.0) for one in made[1:]]
    return Trainer(made[0], scene, "squared", 0.0, others=others)


def found(one):
    return [one.rt.to_numpy(a).copy() for a in one.collected()]


@PLACES
@FIELDS
def test_gradients_are_the_sum_over_devices(field, places, scene):
    first = trainers(scene, field, places)
    for one in first.team:
        one.compare()
    alone = [found(one) for one in first.team]
    assert any((a != b).any() for a, b in zip(*alone, strict=True))  # rays of their own
    first.add([one.collected() for one in first.team])
    for one in first.team:
        for together, *parts in zip(found(one), *alone, strict=True):
            rule = np.maximum if together.dtype == np.uint8 else np.add
            np.testing.assert_array_equal(together, rule(*parts))
    assert [one.learning.scale for one in first.team] == [SHARE / 2] * 2


@PLACES
@WILD
def test_gradients_of_photographs_are_the_sum_over_devices(wild, places, scene):
    """Those of lights, and of what passes."""
    first = trainers(scene, TINY, places, wild)
    for one in first.team:
        one.rt.write(one.learning.step, LATER)
        one.compare()
    beside = [[one.appearance, one.passing] for one in first.team]
    tables = [[t.table for t in pair if t is not None] for pair in beside]
    assert len(tables[0]) == 1 + wild.transient
    alone = [[one.rt.to_numpy(t.gradients).copy() for t in own]
             for one, own in zip(first.team, tables, strict=True)]  # fmt: skip
    first.add([one.collected() for one in first.team])
    for one, own in zip(first.team, tables, strict=True):
        for table, here, there in zip(own, *alone, strict=True):
            assert here.any()
            assert (here != there).any()
            np.testing.assert_array_equal(one.rt.to_numpy(table.gradients), here + there)


def learn_together(first, steps=20):
    """Take steps as a training does."""
    for step in range(steps):
        for one in first.team:
            one.rt.write(one.learning.progress, np.array([step / steps], np.float32))
            one.tend(step, step == 0, step / steps)
        first.repeat()
        for one in first.team:
            one.fill()


@PLACES
@FIELDS
def test_devices_keep_equal_parameters(field, places, scene):
    first = trainers(scene, field, places)
    learn_together(first)  # 'voxel' refines its grid on the way
    states = [one.field.state() for one in first.team]
    assert all(np.array_equal(states[0][name], states[1][name]) for name in states[0])


@PLACES
@WILD
def test_devices_keep_equal_photographs(wild, places, scene):
    first = trainers(scene, TINY, places, wild)
    for one in first.team:
        one.rt.write(one.learning.step, LATER)
    learn_together(first)
    for one in first.team:
        one.keep()
    extras = [one.model.extra for one in first.team]
    learnt = [name for name in extras[0] if name.endswith("values")]
    assert len(learnt) == 1 + wild.transient
    for name in learnt:
        assert np.abs(np.diff(extras[0][name], axis=0)).max() > 0  # a photograph of its own each
        np.testing.assert_array_equal(extras[0][name], extras[1][name])


@PLACES
def test_two_devices_learn_a_scene(places, scene):
    model = fit(scene, TINY, steps=200, devices=places, progress=False)
    # 17.6 dB; one device reaches 15.7 after as many steps.
    assert model.training.marks[-1].test_psnr > 16.6


def test_refused(scene):
    with pytest.raises(ValueError, match="devices must name at least one"):
        fit(scene, TINY, steps=1, devices=())
    with pytest.raises(ValueError, match=r"device must be one that warp finds"):
        fit(scene, TINY, steps=1, devices=("cpu", "cuda:77"))
    with pytest.raises(ValueError, match="robust must not go with several devices"):
        fit(scene, TINY, steps=1, devices=("cpu", "cpu"), robust=True)
    with pytest.raises(TypeError, match="devices must be names"):
        fit(scene, TINY, steps=1, devices=3)  # pyright: ignore[reportArgumentType]
