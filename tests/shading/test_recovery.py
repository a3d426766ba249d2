"""Shape from shading on rendered bodies, and where one image cannot tell."""

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion

import cvkern
from cvkern.shading.integration import Solver
from tests.shading import data

F32, U8 = np.float32, np.uint8
FRONTAL, OBLIQUE = np.array([0, 0, 1.0]), np.array([0.4, 0.3, 0.85])


def sphere(n=64):
    y, x = np.indices((n, n)) - (n - 1) / 2
    mask = x**2 + y**2 < (0.4 * n) ** 2
    return data.round_normals(mask), mask


def vase(n=96):
    """Return a body of revolution around an upright axis, whose ends are cut."""
    y, x = np.indices((n, n))
    t, x, height = (y - 0.08 * n) / (0.84 * n), x - (n - 1) / 2, 0.84 * n

    def profile(t):
        return height * (0.15 - 0.1 * t * (6 * t + 1) ** 2 * (t - 1) ** 2 * (3 * t - 2))

    radius = profile(t)
    slope = (profile(t + 1e-5) - profile(t - 1e-5)) / 2e-5 / height
    mask = (t >= 0) & (t <= 1) & (np.abs(x) < radius)
    z = np.sqrt(np.maximum(radius**2 - x**2, 1e-9))
    normals = np.stack([x, radius * slope, z], axis=-1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True), mask


def render(normals, mask, light):
    return np.maximum(normals @ light, 0) * mask


@pytest.mark.parametrize(
    ("body", "light", "most"),
    [
        (sphere, FRONTAL, 0.5), (sphere, OBLIQUE, 1.0),
        (vase, FRONTAL, 1.8), (vase, OBLIQUE, 2.8),
    ],
)  # fmt: skip
def test_bodies(backend, body, light, most):
    normals, mask = body()
    light = light / np.linalg.norm(light)
    image = render(normals, mask, light) * 1.5
    found = cvkern.shape_from_shading(image, light * 2, mask=mask, albedo=0.75)
    assert data.apart(found.normals, normals, mask) < most
    np.testing.assert_array_equal(np.isfinite(found.depth), mask)
    np.testing.assert_array_equal(np.isfinite(found.normals).all(axis=-1), mask)
    inner = mask & (normals[..., 2] > 0.4)
    if body is sphere:
        depth = -0.4 * 64 * normals[..., 2]
        off = (found.depth - depth)[inner]
        assert off.std() < 0.5


@pytest.mark.parametrize(
    ("body", "light", "wider", "most"),
    [(sphere, OBLIQUE, 1, 1.0), (sphere, FRONTAL, -2, 1.0), (vase, OBLIQUE, -1, 3.0)],
)
def test_masks_that_are_wider_or_narrower_than_the_body(backend, body, light, wider, most):
    """With a mask one pixel off, border pixels once counted as cuts, and errors were 12 to 20."""
    normals, mask = body()
    light = light / np.linalg.norm(light)
    change = binary_dilation if wider > 0 else binary_erosion
    given = change(mask, iterations=abs(wider))
    found = cvkern.shape_from_shading(render(normals, mask, light), light, mask=given, rounds=30)
    assert data.apart(found.normals, normals, mask & given) < most


def test_known_normals_at_the_border(backend):
    """A saddle without a silhouette; what is known at its border tells which one it is."""
    y, x = np.indices((40, 40)) - 19.5
    for sign in (1, -1):
        depth = sign * (x**2 - y**2) / 60
        normals = cvkern.normals_from_depth(depth).astype(float)
        known = np.full_like(normals, np.nan)
        for edge in (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1]):
            known[edge] = normals[edge]
        image = cvkern.lambertian(normals, OBLIQUE)
        found = cvkern.shape_from_shading(image, OBLIQUE, boundary=known)
        assert data.apart(found.normals, normals, np.ones((40, 40), bool)) < 1


def test_a_solver_ends_where_only_rounding_errors_are_left(monkeypatch):
    """Normals that are all known never change, so each round begins with the solution."""
    steps = []
    solve = Solver.solve
    monkeypatch.setattr(Solver, "solve", lambda *given: steps.append(solve(*given)))
    rng = np.random.default_rng(4)
    normals = rng.normal((0, 0, 1), 0.3, (33, 8, 3))
    cvkern.shape_from_shading(np.ones((33, 8)), (0, 0, 1), boundary=normals, rounds=4)
    assert len(steps) == 5
    assert max(steps) < 40


def test_scattered_pixels_end_in_time(monkeypatch):
    """Coarse levels do not show their thin bridges, so that each solution would take many steps."""
    steps = []
    solve = Solver.solve
    monkeypatch.setattr(Solver, "solve", lambda *given: steps.append(solve(*given)))
    rng = np.random.default_rng(1)
    image, known = rng.random((64, 70)), rng.normal((0, 0, 1), 0.3, (64, 70, 3))
    known[rng.random((64, 70)) < 0.9] = np.nan
    mask = rng.random((64, 70)) < 0.6
    cvkern.shape_from_shading(image, (0, 0, 1), mask=mask, boundary=known, rounds=4)
    assert len(steps) == 5
    assert 40 < steps[0] < 400  # the first is solved
    assert max(steps[1:-1]) == 40
    assert 0 < steps[-1] < 400  # and so is the last


def test_a_sweep(kernels):
    """The mean of those around, with z of length 1, and then the nearest of the cone."""
    rng = np.random.default_rng(0)
    n = rng.normal(0, 0.3, (7, 9, 3)) + np.array([0, 0, 1])
    n = (n / np.linalg.norm(n, axis=-1, keepdims=True)).astype(F32)
    image = rng.random((7, 9)).astype(F32)
    image[3, 4] = 0
    state = rng.integers(0, 3, (7, 9)).astype(U8)
    guide = np.full((7, 9, 3), np.nan, F32)
    guide[2:5] = n[1:4]
    light = OBLIQUE / np.linalg.norm(OBLIQUE)
    got = kernels(
        "shading.recovery.sweep", n, image, state, guide, tuple(light), out=[((7, 9, 3), F32)]
    )
    for y, x in np.ndindex(7, 9):
        want = n[y, x].astype(float)
        if state[y, x] == 2:
            around = [
                n[v, u] for v, u in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1))
                if 0 <= v < 7 and 0 <= u < 9 and state[v, u]
            ]  # fmt: skip
            mean = np.mean(around, axis=0) if around else want
            if np.isfinite(guide[y, x, 2]):
                share = 0.5 * np.clip((n[y, x, 2] - 0.1) / 0.3, 0, 1)
                mean = (1 - share) * mean + share * guide[y, x]
            mean[2] = np.sqrt(max(1 - mean[0] ** 2 - mean[1] ** 2, 0))
            along = mean @ light
            across = mean - along * light
            across /= np.linalg.norm(across)
            shown = image[y, x]
            want = mean
            if shown > 0 or along > 0:
                want = shown * light + np.sqrt(1 - shown**2) * across
        # A short part across the light may lose three digits of float32.
        np.testing.assert_allclose(got[y, x], want, atol=1e-4)


IMAGE = np.ones((6, 8))


@pytest.mark.parametrize(
    ("message", "image", "light", "options"),
    [
        ("light must be three finite numbers, got [1.0, 2.0]", IMAGE, [1, 2], {}),
        ("light must have z > 0, from the camera's side, got [1.0, 0.0, 0.0]", IMAGE,
         [1, 0, 0], {}),
        ("mask must not be 0 everywhere, got such a mask", IMAGE * 0, [0, 0, 1], {}),
        ("mask must have shape (6, 8), got (8, 6)", IMAGE, [0, 0, 1], {"mask": IMAGE.T}),
        ("image must be finite within the mask, got others", IMAGE * np.nan, [0, 0, 1],
         {"mask": IMAGE}),
        ("image must be at most albedo times the length of light, got a median of 2 times that: "
         "give the albedo in the units of the image", IMAGE, [0, 0, 0.5], {}),
        ("boundary must have shape (6, 8, 3), got (6, 8, 2)", IMAGE, [0, 0, 1],
         {"boundary": np.ones((6, 8, 2))}),
        ("boundary must have at least one normal, got none: no part of the mask's border is as "
         "bright as a silhouette", IMAGE, [0, 0, 1], {}),
    ],
)  # fmt: skip
def test_errors(no_kernel_runs, message, image, light, options):
    with pytest.raises(ValueError) as info:  # noqa: PT011  (the whole message is compared)
        cvkern.shape_from_shading(image, light, **options)
    assert str(info.value) == message
