"""Training on several devices: sums of gradients, equal parameters, and what is refused."""

import numpy as np
import pytest

import cvkern
from cvkern.radiance import fit, make_scene
from cvkern.radiance.trainer import SHARE, Trainer
from cvkern.radiance.training import Wild, _begin
from tests.radiance.runs import FIELDS, TINY

TAME = Wild(None, None, False, False)
GPUS = pytest.param(("cuda:0", "cuda:1"), id="cuda", marks=pytest.mark.skipif(
    "cuda:1" not in cvkern.devices(), reason="needs two GPUs"))  # fmt: skip
PLACES = pytest.mark.parametrize("places", [pytest.param(("cpu", "cpu"), id="cpu"), GPUS])


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=8, test=2, size=24)


def trainers(scene, field, places):
    made = []
    for place in places:
        with cvkern.use(device=place):
            made.append(_begin(scene, field, None, 3, TAME, None))
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
@FIELDS
def test_devices_keep_equal_parameters(field, places, scene):
    first = trainers(scene, field, places)
    for step in range(20):  # 'voxel' refines its grid on the way
        for one in first.team:
            one.rt.write(one.learning.progress, np.array([step / 20], np.float32))
            one.tend(step, step == 0, step / 20)
        first.repeat()
        for one in first.team:
            one.fill()
    states = [one.field.state() for one in first.team]
    assert all(np.array_equal(states[0][name], states[1][name]) for name in states[0])


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
