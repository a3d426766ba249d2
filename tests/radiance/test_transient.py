"""The transient head: its loss and gradients against NumPy in float64, and training."""

from typing import Any

import numpy as np
import pytest

from cvkern._runtime import runtime
from cvkern.kernels.codes.radiance import Background, Comparison, Head, WildGradients
from cvkern.radiance import HashField, evaluate, fit, load_model, make_scene, render_transient
from cvkern.radiance.models import nodes_of
from cvkern.radiance.rendering import owned
from profiling.experiments.wild_quality import changed
from tests.radiance.runs import GRID, interrupt, press_ctrl_c, same

RAYS, ACTIVE, WIDTH, HEIGHT, SIDE, VIEWS = 50, 45, 11, 9, 4, 3
LEAST, RATE, SCALE = 0.1, 0.3, 128.0
BEHIND = np.array([0.2, 0.9, 0.4])
NAMES = "color", "opacity", "learnt", "nodes"


def softplus(x):
    return np.logaddexp(0, x)


def logistic(x):
    return 1 / (1 + np.exp(-x))


class Case:
    """Random rays over a learnt background, some of them of clipped colours."""

    def __init__(self):
        rng = np.random.default_rng(0)
        _, rows, columns = nodes_of(HEIGHT, WIDTH)
        self.nodes = rng.normal(size=(VIEWS, rows, columns, 5))
        self.color, self.opacity = rng.random((RAYS, 3)), rng.random(RAYS)
        self.targets = rng.random((RAYS, 4))
        self.targets[::2, 3] = 1
        self.targets[::6, 0] = 1
        self.targets[2::6, 1] = 0
        self.color[2::6, 1] -= 0.8
        self.color[::6, 0] += 0.6
        self.views = rng.integers(0, VIEWS, RAYS)
        self.pixels = rng.integers(0, HEIGHT * WIDTH, RAYS)

    def mixture(self):
        """Return the share of each node in the numbers of each ray, (R, N h w)."""
        found = np.zeros((RAYS, *self.nodes.shape[:3]))
        rays = np.arange(RAYS)
        (i, y), (j, x) = (
            np.divmod(n / SIDE, 1) for n in (self.pixels // WIDTH, self.pixels % WIDTH)
        )
        for di, wi in ((0, 1 - y), (1, y)):
            for dj, wj in ((0, 1 - x), (1, x)):
                found[rays, self.views, i.astype(int) + di, j.astype(int) + dj] += wi * wj
        return found.reshape(RAYS, -1)

    def loss(self, color, opacity, learnt, nodes, active=ACTIVE):
        """Return the loss of all rays, without that of clipped channels."""
        n = self.mixture() @ nodes.reshape(-1, 5)
        density, doubt = softplus(n[:, 0]), softplus(n[:, 4])
        a = 1 - np.exp(-density)
        scene = color + (1 - opacity)[:, None] * learnt
        seen = a[:, None] * logistic(n[:, 1:4]) + (1 - a)[:, None] * scene
        share = self.targets[:, 3:]
        e = seen - share * self.targets[:, :3] - (1 - share) * learnt
        clipped = (self.targets[:, :3] >= 1) & (e > 0) | (self.targets[:, :3] <= 0) & (e < 0)
        e = np.where(clipped & (share >= 1), 0, e)
        b = LEAST + a * doubt
        loss = (e**2).sum(1) / (2 * b**2) + np.log(b) + RATE * density
        self.errors = (e**2).mean(1)
        return SCALE * 2 / 3 * LEAST**2 * loss[:active].sum()


def solved(case, delay=0, active=ACTIVE, sums: Any = np.float32):
    """Return the errors, and the gradients by colours, opacities, backgrounds and nodes."""
    rt = runtime()

    def put(values):
        kind = np.int32 if values.dtype.kind == "i" else np.float32
        return owned(rt, values.astype(kind))

    comparison = Comparison(Background.LEARNT, put(BEHIND), 0.0, SCALE, 0, put(np.array([7])), True)
    head = Head(put(case.nodes), WIDTH, SIDE, LEAST, RATE, delay)
    errors, number = rt.zeros((RAYS,)), put(np.array([active]))
    gradients = WildGradients(*(rt.zeros((RAYS, *tail)) for tail in ((3,), (), (3,), (5,))))
    views, pixels = put(case.views), put(case.pixels)
    kernels = rt.radiance.wild.transient
    kernels.loss(
        put(case.color), put(case.opacity), put(case.targets), views, pixels, number, comparison,
        head, errors, gradients,
    )  # fmt: skip
    d_nodes = rt.zeros(case.nodes.shape, sums)
    kernels.backward(gradients.head, views, pixels, number, head, d_nodes)
    d_color, d_opacity, d_learnt, d_head = (rt.to_numpy(g) for g in gradients)
    return rt.to_numpy(errors), d_color, d_opacity, d_learnt, rt.to_numpy(d_nodes), d_head


@pytest.mark.usefixtures("backend")
def test_gradients_are_central_differences():
    case = Case()
    errors, *found, _ = solved(case)
    given: Any = [case.color, case.opacity, BEHIND, case.nodes]
    case.loss(*given)
    np.testing.assert_allclose(errors[:ACTIVE], case.errors[:ACTIVE], rtol=1e-4, atol=1e-6)
    assert not errors[ACTIVE:].any()
    found[2] = found[2].sum(0)
    rng, step = np.random.default_rng(1), 1e-6
    for at, gradient in enumerate(found):
        scale = np.abs(gradient).max()
        every = list(np.ndindex(*gradient.shape))
        for n in rng.choice(len(every), min(len(every), 60), replace=False):
            ends = []
            for sign in (1, -1):
                moved = [a.copy() for a in given]
                moved[at][every[n]] += sign * step
                ends.append(case.loss(*moved))
            wanted = (ends[0] - ends[1]) / (2 * step)
            assert gradient[every[n]] == pytest.approx(wanted, rel=1e-3, abs=1e-5 * float(scale))


@pytest.mark.usefixtures("backend")
def test_the_backward_pass_is_the_transpose_of_the_interpolation():
    case = Case()
    *_, d_nodes, d_head = solved(case)
    change = np.random.default_rng(3).normal(size=case.nodes.shape)
    along = case.mixture() @ change.reshape(-1, 5)
    assert (d_nodes * change).sum() == pytest.approx((d_head * along).sum(), rel=1e-4)


@pytest.mark.usefixtures("backend")
def test_nothing_passes_before_its_step_and_without_rays():
    case = Case()
    _, d_color, d_opacity, d_learnt, d_nodes, _ = solved(case, delay=8)
    assert not d_nodes.any()
    scene = case.color + (1 - case.opacity)[:, None] * BEHIND
    share = case.targets[:, 3:]
    e = scene - share * case.targets[:, :3] - (1 - share) * BEHIND
    clipped = (case.targets[:, :3] >= 1) & (e > 0) | (case.targets[:, :3] <= 0) & (e < 0)
    e = np.where(clipped & (share >= 1), 0, e)[:ACTIVE]
    assert (e == 0).sum() > 5  # clipped
    # The loss is then the mean squared error of the channels.
    d = 2 / 3 * SCALE * e
    np.testing.assert_allclose(d_color[:ACTIVE], d, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(d_opacity[:ACTIVE], -(d @ BEHIND), rtol=1e-4, atol=1e-4)
    wanted = d * (case.targets[:, 3] - case.opacity)[:ACTIVE, None]
    np.testing.assert_allclose(d_learnt[:ACTIVE], wanted, rtol=1e-4, atol=1e-4)
    assert not any(g.any() for g in solved(case, active=0))


@pytest.fixture(scope="module")
def clean():
    return make_scene(train=20, test=3, size=32)


def test_the_head_takes_what_passes_and_leaves_a_clean_scene(clean, tmp_path):
    wild, options = changed(clean, "occluder"), {"steps": 400, "progress": False}
    plain, model = (fit(wild, GRID, transient=t, **options) for t in (False, True))
    assert evaluate(model, wild).psnr.mean() > evaluate(plain, wild).psnr.mean() + 2
    hidden = (wild.images != clean.images).any(axis=3)
    views = np.flatnonzero(hidden.any(axis=(1, 2))).tolist()
    passing = [render_transient(model, v) for v in views]
    opacity = np.stack([p.opacity for p in passing])
    assert opacity[hidden[views]].mean() > 10 * opacity[~hidden[views]].mean()
    assert passing[0].color.shape == (32, 32, 3)
    held = int(np.flatnonzero(clean.test)[0])
    assert not render_transient(model, held).opacity.any()
    scores = [evaluate(fit(clean, GRID, transient=t, **options), clean) for t in (False, True)]
    assert scores[1].psnr.mean() > scores[0].psnr.mean() - 0.3
    file = tmp_path / "model.npz"
    model.save(file, resumable=False)
    read = render_transient(load_model(file), int(views[0]))
    np.testing.assert_array_equal(read.opacity, passing[0].opacity)
    with pytest.raises(ValueError, match="model must be trained with transient=True"):
        render_transient(plain, 0)
    with pytest.raises(ValueError, match="view must be in"):
        render_transient(model, 23)


@pytest.mark.parametrize(
    "field",
    [GRID, HashField(levels=8, table_bits=10, samples=2**11, rays=128, cells=32)],
    ids=["voxel", "hash"],
)
def test_runs_are_equal_and_go_on(clean, tmp_path, monkeypatch, field):
    file, wild = tmp_path / "model.npz", changed(clean, "both")
    options = {"steps": 120, "progress": False, "appearance": "affine", "transient": True}
    straight = fit(wild, field, **options)
    with monkeypatch.context() as patch:
        interrupt(patch, 109, press_ctrl_c)
        fit(wild, field, checkpoint=file, **options)
    on = fit(wild, field, checkpoint=file, resume=True, **options)
    assert same(on, straight)
    for name in ("values", "mean", "square", "views"):
        np.testing.assert_array_equal(
            on.extra[f"transient.{name}"], straight.extra[f"transient.{name}"]
        )
    assert np.ptp(render_transient(on, 5).opacity) > 0


def test_refusals(clean):
    mistakes: Any = {"robust": {"robust": True}, "the loss 'huber'": {"loss": "huber"}}
    for other, given in mistakes.items():
        with pytest.raises(ValueError, match=f"transient must not go with {other}"):
            fit(clean, GRID, steps=1, transient=True, **given)
