"""Functions that PyTorch differentiates, against SciPy's filters and PyTorch's own gradients."""

import doctest
import sys

import numpy as np
import pytest
import scipy.ndimage as ndi

import cvkern

torch = pytest.importorskip("torch")

MODES = ["reflect", "constant", "nearest", "mirror", "wrap"]


def noise(*shape, seed=0):
    return torch.from_numpy(np.random.default_rng(seed).normal(size=shape).astype(np.float32))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("sigma", "order"), [((1.0, 2.0), 0), ((3.0, 0.6), (1, 2))])
def test_gaussian(mode, sigma, order):
    """The gradient is the transpose of the matrix whose columns SciPy computes."""
    image, weights = noise(5, 7).requires_grad_(), noise(5, 7, seed=1)
    seen = cvkern.torch.gaussian(image, sigma, order=order, mode=mode, cval=3.0)
    torch.testing.assert_close(
        seen.detach(), cvkern.gaussian(image.detach(), sigma, order=order, mode=mode, cval=3.0)
    )
    (seen * weights).sum().backward()
    columns = [
        ndi.gaussian_filter(one.reshape(5, 7), sigma, order, mode=mode) for one in np.eye(35)
    ]
    want = np.array([(column * weights.numpy()).sum() for column in columns]).reshape(5, 7)
    np.testing.assert_allclose(image.grad, want, atol=2e-6 * max(1, np.abs(want).max()))


@pytest.mark.parametrize("mode", ["reflect", "constant"])
@pytest.mark.parametrize(
    ("shape", "axes"),
    [
        ((6, 8, 3), {"channel_axis": 2}),
        ((6, 3, 8), {"channel_axis": 1}),
        ((3, 6, 8), {"channel_axis": 0}),
        ((3, 6, 8), {"batch_axis": 0}),
        ((2, 6, 8, 3), {"batch_axis": 0, "channel_axis": -1}),
    ],
)
def test_gaussian_of_channels_and_stacks(mode, shape, axes):
    image = noise(*shape).to(torch.float64).requires_grad_()
    weights = noise(*shape, seed=1)
    (cvkern.torch.gaussian(image, 1.5, mode=mode, **axes) * weights).sum().backward()
    assert image.grad.dtype == torch.float64
    across = axes.get("channel_axis", -9) % len(shape) if "channel_axis" in axes else -1
    kept = {0} if "batch_axis" in axes else set()
    kept |= {across} if across >= 0 else set()
    free = [k for k in range(len(shape)) if k not in kept]
    rows = np.moveaxis(weights.numpy(), free, (-2, -1)).reshape(-1, 6, 8)
    want = []
    for row in rows:
        plane = row.copy()
        other = torch.zeros(6, 8, requires_grad=True)
        (cvkern.torch.gaussian(other, 1.5, mode=mode) * torch.from_numpy(plane)).sum().backward()
        want.append(other.grad.numpy())
    found = np.moveaxis(image.grad.numpy(), free, (-2, -1)).reshape(-1, 6, 8)
    np.testing.assert_allclose(found, want, atol=1e-6)


def test_remap():
    image, rows, columns = noise(9, 11), 10 * noise(6, 5).sigmoid() - 1, 12 * noise(6, 5).sigmoid()
    weights = noise(6, 5, seed=3)

    def own(image, rows, columns):
        return cvkern.torch.remap(image, torch.stack((rows, columns)))

    def theirs(image, rows, columns):
        grid = torch.stack((columns / 5 - 1, rows / 4 - 1), -1)
        return torch.nn.functional.grid_sample(
            image[None, None], grid[None], align_corners=True, padding_mode="zeros"
        )[0, 0]

    inside = (rows > 0) & (rows < 8) & (columns > 0) & (columns < 10)
    assert 8 < inside.sum() < 30
    found = []
    for function in (own, theirs):
        given = [a.clone().requires_grad_() for a in (image, rows, columns)]
        (function(*given) * weights * inside).sum().backward()
        found.append([a.grad for a in given])
    for a, b in zip(*found, strict=True):
        torch.testing.assert_close(a, b, atol=1e-4, rtol=1e-4)


def test_composite_rays():
    density, color = noise(12).abs(), noise(12, 3)
    lengths = noise(12, seed=2).abs() / 4
    distances = torch.stack((lengths.cumsum(0), lengths), 1)
    spans = torch.tensor([[0, 5], [5, 0], [5, 7]])
    weights = noise(3, seed=3), noise(3, seed=4)

    def own(density, color):
        seen = cvkern.torch.composite_rays(density, color, distances, spans, stop=0.0)
        return seen.color, seen.depth

    def theirs(density, color):
        colors, depths = [], []
        for first, count in spans.tolist():
            part = slice(first, first + count)
            thick = density[part] * lengths[part]
            light = torch.exp(thick - thick.cumsum(0)) * (1 - torch.exp(-thick))
            colors.append(light @ color[part])
            depths.append((light * distances[part, 0]).sum())
        return torch.stack(colors), torch.stack(depths)

    found = []
    for function in (own, theirs):
        given = [a.clone().requires_grad_() for a in (density, color)]
        colors, depths = function(*given)
        (colors @ weights[0] * weights[1]).sum().add(depths @ weights[0]).backward()
        found.append([colors.detach(), depths.detach(), *(a.grad for a in given)])
    for a, b in zip(*found, strict=True):
        torch.testing.assert_close(a, b, atol=1e-5, rtol=1e-4)


def test_gradients_of_gradients_are_refused():
    image = noise(4, 5).requires_grad_()
    squares = (cvkern.torch.gaussian(image) ** 2).sum()
    (by,) = torch.autograd.grad(squares, image, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        by.sum().backward()


@pytest.mark.parametrize("name", cvkern.torch.__all__)
def test_examples(name):
    """Of the docstrings; test_docstrings.py runs where there is no torch."""
    (found,) = doctest.DocTestFinder(recurse=False).find(getattr(cvkern.torch, name), globs={})
    assert doctest.DocTestRunner().run(found).failed == 0


def test_nothing_to_differentiate():
    assert not cvkern.torch.gaussian(noise(4, 5)).requires_grad
    with pytest.raises(ValueError, match="sigma must be >= 0"):
        cvkern.torch.gaussian(noise(4, 5), -1.0)


def test_without_pytorch(monkeypatch):
    from cvkern.torch import _functions

    _functions.cache_clear()
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ModuleNotFoundError, match=r"cvkern\.torch needs PyTorch"):
        cvkern.torch.gaussian(np.eye(4))
    monkeypatch.undo()
    _functions.cache_clear()
