"""Depth from normals: against SciPy's direct solver, on known surfaces, part by part."""

import numpy as np
import pytest
import scipy.sparse as sparse
from scipy.ndimage import label
from scipy.sparse.linalg import spsolve

import cvkern
from cvkern._runtime import runtime
from cvkern.shading.rectangles import _on_host, solve_by_kernels

F32, U8 = np.float32, np.uint8


def peaks(n, noise=0.0):
    """Return depth of hills and normals by its closed form, with noise."""

    def depth(x, y):
        hill = 3 * (1 - x) ** 2 * np.exp(-(x**2) - (y + 1) ** 2)
        dale = 10 * (x / 5 - x**3 - y**5) * np.exp(-(x**2) - y**2)
        return -(hill - dale - np.exp(-((x + 1) ** 2) - y**2) / 3) * n / 64

    x = np.linspace(-3, 3, n)
    x, y = np.meshgrid(x, x)
    h, step = 1e-5, 6 / (n - 1)
    a = (depth(x + h, y) - depth(x - h, y)) / (2 * h) * step
    b = (depth(x, y + h) - depth(x, y - h)) / (2 * h) * step
    normals = np.stack([a, -b, np.ones_like(a)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals += np.random.default_rng(0).normal(0, noise, normals.shape)
    return depth(x, y), normals


def disc(n):
    y, x = np.indices((n, n)) - (n - 1) / 2
    return x**2 + y**2 < (0.45 * n) ** 2


def rms(found, right, mask):
    off = (found - right)[mask]
    return np.sqrt(np.mean((off - off.mean()) ** 2))


def without_curve(slopes, mask):
    """Return slopes along rows less a twelfth of their second derivatives, run by run of a mask."""
    result = slopes.copy()
    for y, row in enumerate(mask):
        ends = np.flatnonzero(np.diff(np.concatenate([[0], row, [0]])))
        for begin, end in ends.reshape(-1, 2):
            run = slopes[y, begin:end]
            if end - begin > 2:
                second = np.convolve(run, [1, -2, 1], "valid")
                change = np.concatenate([second[:1], second, second[-1:]])
                if end - begin > 4:
                    change[2:-2] = np.convolve(run, [1, -3, 4, -3, 1], "valid")
                result[y, begin:end] = run - change / 12
    return result


def equations(normals, mask, curved=True):
    """Return the matrix and the right side of the rises of all edges within a mask."""
    numbers = np.where(mask, np.cumsum(mask).reshape(mask.shape) - 1, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = normals[..., 0] / normals[..., 2], -normals[..., 1] / normals[..., 2]
    if curved:
        slopes = without_curve(slopes[0], mask), without_curve(slopes[1].T, mask.T).T
    first, second, rises = [], [], []
    for slope, (a, b) in zip(
        slopes, ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])), strict=True
    ):
        both = mask[a] & mask[b]
        first.append(numbers[a][both])
        second.append(numbers[b][both])
        rises.append((slope[a] + slope[b])[both] / 2)
    first, second, rises = (np.concatenate(v) for v in (first, second, rises))
    rows = np.arange(len(rises))
    one = np.ones(len(rises))
    entries = np.concatenate([-one, one]), (np.tile(rows, 2), np.concatenate([first, second]))
    return sparse.csr_matrix(entries, shape=(len(rises), mask.sum())), rises


@pytest.mark.parametrize("shape", [(1, 9), (2, 2), (37, 50)])
def test_against_a_direct_solver(backend, shape):
    """Energy and depth, also in parts that touch at corners, or are one pixel."""
    _, normals = peaks(50, 0.1)
    normals = normals[: shape[0], : shape[1]]
    mask = np.random.default_rng(1).random(shape) < 0.8
    mask[0, :2] = True
    normals[0, -1] = [0.1, 0.1, -1]  # faces away
    mask[0, -1] = True
    found = cvkern.integrate_normals(normals, mask, tolerance=1e-7)
    mask[0, -1] = False
    np.testing.assert_array_equal(np.isfinite(found), mask)
    matrix, rises = equations(normals, mask)
    square = (matrix.T @ matrix + 1e-9 * sparse.eye(mask.sum())).tocsc()
    right = np.asarray(spsolve(square, matrix.T @ rises))
    numbers = np.asarray(label(mask)[0], int)  # pyright: ignore[reportIndexIssue]
    parts = numbers[mask]
    means = np.bincount(parts, right) / np.maximum(np.bincount(parts), 1)
    # Depth is of at most a few tens, found to 1e-7 of the energy's norm, and rounded to float32.
    np.testing.assert_allclose(found[mask], right - np.take(means, parts), atol=2e-5)
    energies = [((matrix @ z - rises) ** 2).sum() for z in (found[mask].astype(float), right)]
    assert energies[0] <= energies[1] * (1 + 1e-5) + 1e-9
    for part in range(1, parts.max() + 1):
        assert abs(found[mask][parts == part].mean()) < 1e-5


@pytest.mark.parametrize(
    ("masked", "noise", "most"),
    [
        (False, 0, 0.00002), (False, 0.02, 0.021), (False, 0.05, 0.061),
        (True, 0, 0.00005), (True, 0.02, 0.0225), (True, 0.05, 0.068),
    ],
)  # fmt: skip
def test_noise(backend, masked, noise, most):
    depth, normals = peaks(256, noise)
    mask = disc(256) if masked else np.ones((256, 256), bool)
    found = cvkern.integrate_normals(normals, mask if masked else None)
    assert rms(found, depth, mask) < most
    matrix, rises = equations(normals, mask)
    z = found[mask].astype(float)
    # The gradient of the energy vanishes at its least value.
    gradient = matrix.T @ (matrix @ z - rises)
    assert np.linalg.norm(gradient) < 1e-4 * np.linalg.norm(matrix.T @ rises)


@pytest.mark.parametrize("shape", [(1, 9), (24, 35), (64, 14), (37, 64)])
def test_rectangles_by_kernels(backend, shape):
    """GPUs transform in float32: factors of 8, others, primes, odd sides and lines."""
    normals = np.random.default_rng(0).normal(size=(*shape, 3)) * [0.3, 0.3, 0] + [0, 0, 1]
    matrix, rises = equations(normals, np.ones(shape, bool), curved=False)
    square = (matrix.T @ matrix + 1e-9 * sparse.eye(normals[..., 0].size)).tocsc()
    right = np.asarray(spsolve(square, matrix.T @ rises)).reshape(shape)
    slope = np.stack([normals[..., 0], -normals[..., 1], normals[..., 2]]).astype(F32)
    found = np.full(shape, 77, F32)
    rt = runtime(slope)
    solve_by_kernels(rt, rt.adopt(slope), rt.adopt(found))
    # Slopes of 0.3 have transforms of some 0.3 sqrt(pixels), each to a few roundings of float32;
    # the least eigenvalue of 64 pixels magnifies that by 400, and the inverse divides by the root.
    np.testing.assert_allclose(found, right - right.mean(), atol=400 * 0.3 * 4 * 6e-8)
    # On the CPU itself the transforms are SciPy's, in float64.
    found = _on_host(slope)
    np.testing.assert_allclose(found, right - right.mean(), atol=1e-6)


@pytest.mark.parametrize("shape", [(64, 256), (131, 90)])
@pytest.mark.parametrize("set_of_kernels", ["warp", "taichi"])
def test_rectangles_on_cuda(gpu, set_of_kernels, shape):
    normals = np.random.default_rng(0).normal(size=(*shape, 3)) * [0.3, 0.3, 0] + [0, 0, 1]
    want = cvkern.integrate_normals(normals)
    with cvkern.use(backend=set_of_kernels, device="cuda"):
        found = cvkern.integrate_normals(normals)
    # The same bound for 256 pixels, whose least eigenvalue magnifies by 6600.
    np.testing.assert_allclose(found, want, atol=6600 * 0.3 * 4 * 6e-8)
    normals[3, 5] = np.nan
    want = cvkern.integrate_normals(normals, tolerance=1e-7)
    with cvkern.use(backend=set_of_kernels, device="cuda"):
        found = cvkern.integrate_normals(normals, tolerance=1e-7)
    np.testing.assert_allclose(found, want, atol=2e-5)


def ramp(n=64, noise=0.0):
    """Return a floor, and a ramp beside it that leaves it gradually."""
    y, x = np.indices((n, n)).astype(float)
    rising = (y >= n / 2) & (x > n / 4)
    depth = np.where(rising, 0.6 * (x - n / 4), 0)
    normals = np.stack([np.where(rising, 0.6, 0), 0 * x, 0 * x + 1], axis=-1)
    normals += np.random.default_rng(0).normal(0, noise, normals.shape)
    return depth, normals


def test_a_jump_is_kept(backend):
    depth, normals = ramp(noise=0.01)
    everywhere = np.ones(depth.shape, bool)
    smooth = cvkern.integrate_normals(normals)
    kept = cvkern.integrate_normals(normals, method="bilateral")
    assert rms(smooth, depth, everywhere) > 5
    assert rms(kept, depth, everywhere) < 1
    # Where there is no jump, the two agree.
    depth, normals = peaks(64, 0.01)
    kept = cvkern.integrate_normals(normals, method="bilateral")
    assert rms(kept, depth, everywhere) < 1.3 * rms(
        cvkern.integrate_normals(normals), depth, everywhere
    )


def test_bilateral_weights_and_equations(backend):
    """With the weights that the result has, the result is the least of their energy."""
    _, normals = ramp(24, 0.02)
    n = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    z = cvkern.integrate_normals(normals, method="bilateral", iterations=300, tolerance=1e-7)
    z = z.astype(float)
    gradient = np.zeros_like(z)
    for axis, slope in ((1, n[..., 0] / n[..., 2]), (0, -n[..., 1] / n[..., 2])):
        d = np.diff(z, axis=axis)
        pad = [(0, 0), (0, 0)]
        pad[axis] = (1, 0)
        before = np.pad(d, pad)
        pad[axis] = (0, 1)
        after = np.pad(d, pad)
        share = 1 / (1 + np.exp(-2 * n[..., 2] ** 2 * (before**2 - after**2)))
        a = np.take(share * n[..., 2] ** 2, range(23), axis)
        b = np.take((1 - share) * n[..., 2] ** 2, range(1, 24), axis)
        s = np.take(slope, range(23), axis), np.take(slope, range(1, 24), axis)
        pull = a * (d - s[0]) + b * (d - s[1])
        pad[axis] = (1, 0)
        gradient += np.pad(pull, pad)
        pad[axis] = (0, 1)
        gradient -= np.pad(pull, pad)
    # The loop ends where the energy falls by less than 1e-4 of itself.
    assert np.abs(gradient).max() < 0.02


def test_both_sets_agree(all_kernels):
    """One cycle of the preconditioner, from the same right side, to the rounding of float32."""
    rng = np.random.default_rng(0)
    weights = rng.random((2, 13, 18)).astype(F32)
    weights[0, :, -1] = weights[1, -1] = 0
    b = rng.normal(size=(13, 18)).astype(F32)
    inside = np.ones((13, 18), U8)
    results = []
    for kernels in all_kernels:
        name = "shading.integration.multigrid."
        x = np.zeros((13, 18), F32)
        for color in (0, 1):
            x = kernels(f"{name}smooth", weights, b, color, out=[x])
        left = kernels(f"{name}restrict", weights, b, x, out=[((7, 9), F32)])
        coarse, _ = kernels(f"{name}coarsen", weights, inside, out=[((2, 7, 9), F32), ((7, 9), U8)])
        solved = kernels(f"{name}settle", coarse, left, 8, out=[((7, 9), F32)])
        results.append(kernels(f"{name}prolong", solved, out=[x]))
    np.testing.assert_allclose(*results, atol=1e-5)


def test_errors(no_kernel_runs):
    up = np.full((3, 4, 3), [0, 0, 1.0])
    for message, arguments, options in (
        ("normals must have shape (H, W, 3), got (3, 4, 2)", (up[..., :2],), {}),
        ("mask must have shape (3, 4), got (4, 3)", (up, np.ones((4, 3))), {}),
        ("tolerance must be in (0, 1), got 0", (up,), {"tolerance": 0}),
        ("sharpness must be > 0, got 0", (up,), {"sharpness": 0}),
        ("iterations must be in [1, 10000], got 0", (up,), {"iterations": 0}),
    ):
        with pytest.raises(ValueError) as info:  # noqa: PT011  (the whole message is compared)
            cvkern.integrate_normals(*arguments, **options)
        assert str(info.value) == message


def test_nothing_to_integrate(backend):
    message = "mask must not be 0 at all valid normals, got nothing to integrate"
    for normals in (np.full((3, 4, 3), np.nan), np.zeros((3, 4, 3)), -np.ones((3, 4, 3))):
        with pytest.raises(ValueError, match=message):
            cvkern.integrate_normals(normals)
    with pytest.raises(ValueError, match=message):
        cvkern.integrate_normals(np.ones((3, 4, 3)), np.zeros((3, 4)))
