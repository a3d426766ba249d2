"""The voxel field: its settings and states, and its training from run to run."""

import threading

import numpy as np
import pytest

import cvkern
from cvkern._runtime import runtime
from cvkern.radiance import VoxelField, fit, load_model, make_scene
from cvkern.radiance.fields.field import Frame
from cvkern.radiance.fields.voxel import VoxelGrid
from cvkern.radiance.scenes.photographs import Bounds
from cvkern.radiance.trainer import Trainer
from tests.radiance.test_views import rays_from_outside, see

F32, I32 = np.float32, np.int32

SMALL = VoxelField(resolutions=(16, 32), shares=(0.4,), rays=512)


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=12, test=2, size=32)


def resolution_of(model):
    assert isinstance(model.field, VoxelGrid)
    return model.field.resolution


def test_training_is_the_same_from_run_to_run_and_with_any_number_of_threads(scene, monkeypatch):
    states = []
    for threads in ("1", "2", "4"):
        monkeypatch.setenv("CVKERN_NUM_THREADS", threads)
        with cvkern.use(backend="warp", device="cpu"):
            states.append(fit(scene, SMALL, steps=40, progress=False).field.state())
    for state in states[1:]:
        for name, values in states[0].items():
            assert np.array_equal(state[name], values), name


class After(threading.Event):
    """An event that is set when it has been asked so many times."""

    def __init__(self, times):
        super().__init__()
        self.times = times

    def is_set(self):
        self.times -= 1
        return self.times < 0


def test_a_training_goes_on_where_it_was_saved(scene, tmp_path):
    file = tmp_path / "model.npz"
    with cvkern.use(backend="warp", device="cpu"):
        whole = fit(scene, SMALL, steps=60, progress=False)
        half = fit(scene, SMALL, steps=1, progress=False)
        for steps, model in ((40, half), (60, None)):  # the finer grid begins at 32
            model = model or load_model(file)
            assert resolution_of(model) == (16 if model is half else 32)
            Trainer(model, scene, "squared", 0.0).train(
                None, 60, After(steps - model.training.step), lambda *_: None, None, 1e9, None
            )
            assert model.training.step == steps
            model.save(file)
        for name, values in whole.field.state().items():
            assert np.array_equal(model.field.state()[name], values), name


def test_densities_are_those_of_the_grid():
    with cvkern.use(backend="warp"):
        for unbounded in (False, True):
            frame = Frame(Bounds((0, 0, 0), 1.0, unbounded), 0.1, 10.0)
            field = SMALL.build(runtime(), frame, 0)
            z, y, x = np.meshgrid(*[np.linspace(-1, 1, 17)] * 3, indexing="ij")
            field.rt.write(field.density, (x + 2 * y - z).astype(F32))
            points = np.array([[0.1, 0.2, 0.3], [0.5, -0.9, 0.9], [3, 0, 0]])
            half = 2 if unbounded else 1
            raw = (points / half) @ (1, 2, -1)
            want = np.where(raw > field.least, np.exp(raw), 0)
            want[2] = np.exp((2 - 1 / 3) / 2) if unbounded else 0
            if unbounded:
                size = np.linalg.norm(points[1])
                raw = points[1] / size * (2 - 1 / size) / 2 @ (1, 2, -1)
                want[1] = np.exp(raw) if raw > field.least else 0
            np.testing.assert_allclose(field.densities(points), want, rtol=1e-5)


@pytest.mark.parametrize("unbounded", [False, True])
def test_to_render_takes_the_nodes_that_are_seen(backend, unbounded):
    rt, frame = runtime(), Frame(Bounds((0, 0, 0), 1.0, unbounded), 0.1, 10.0)
    made, again = (SMALL.build(rt, frame, 0) for _ in range(2))
    rng = np.random.default_rng(0)
    rt.write(made.density, rng.choice(np.array([9, -9], F32), made.density.shape, p=[0.01, 0.99]))
    color = rng.normal(size=made.color.shape).astype(F32)
    color[..., 27:] = 0
    rt.write(made.color, color)
    made._mark()
    whole = made.state()
    assert whole["color"].shape == (17**3, 27)
    state = made.to_render(whole)
    assert 0.1 < len(state["nodes"]) / len(whole["nodes"]) < 0.4  # 27 neighbours of 1 in 100
    again.restore(state)
    rays = rays_from_outside(300)
    want = see(rt, made, *rays)
    assert want[1].max() > 0.9
    # Half precision rounds each node by a share of 2^-12, up to 2^-9 of the logarithm of a density.
    for a, b in zip(see(rt, again, *rays), want, strict=True):
        np.testing.assert_allclose(a, b, rtol=2**-9, atol=2**-12)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"resolutions": (32, 24)}, r"resolutions must be growing multiples of 16, got \(32, 24\)"),
        ({"resolutions": ()}, r"resolutions must be growing multiples of 16, got \(\)"),
        ({"resolutions": (16, 416)}, r"resolutions must be in \[16, 400\], got 416"),
        ({"shares": (0.5,)}, "shares must be 2 numbers, got 1"),
        ({"shares": (0.5, 0.5)}, r"shares must grow between 0 and 1, got \(0.5, 0.5\)"),
        ({"degree": 3}, r"degree must be in \[0, 2\], got 3"),
        ({"rays": 0}, r"rays must be in \[1, 16777216\], got 0"),
        ({"spacing": 0}, "spacing must be > 0, got 0"),
        ({"density_rate": -1.0}, "density_rate must be > 0, got -1.0"),
        ({"spacing": 0.127}, "spacing must be at least 0.128 cells, got 0.127"),
        ({"first": 0.01}, "first must be above 0.032, which counts as empty, got 0.01"),
        ({"smooth_color": -1.0}, "smooth_color must be >= 0 and finite, got -1.0"),
    ],
)
def test_settings_are_checked(settings, message):
    with pytest.raises(ValueError, match=message):
        VoxelField(**settings)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"resolutions": 32}, "resolutions must be a sequence of integers, got 32"),
        ({"shares": 0.3}, "shares must be a sequence of numbers, got 0.3"),
        ({"shares": ("a", "b")}, "shares must be a number, got 'a'"),
    ],
)
def test_settings_of_other_types(settings, message):
    with pytest.raises(TypeError, match=message):
        VoxelField(**settings)


def test_states_are_checked():
    frame = Frame(Bounds((0, 0, 0), 1.0, False), 0.1, 10.0)
    with cvkern.use(backend="warp"):
        field = SMALL.build(runtime(), frame, 0)
        state = field.state()
        with pytest.raises(ValueError, match="density must have a shape of"):
            field.restore(state | {"density": np.zeros((3, 3, 3), F32)})
        with pytest.raises(ValueError, match="state must have 'density'"):
            field.restore({k: v for k, v in state.items() if k != "density"})
        rows = {k: np.zeros((1, v.shape[1]), F32) for k, v in state.items() if v.ndim == 2}
        with pytest.raises(ValueError, match="nodes must be numbers of nodes"):
            field.restore(state | rows | {"nodes": np.array([-1], I32)})
