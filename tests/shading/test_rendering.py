"""Rendering of matt surfaces: closed forms, differences for the gradients, shadows by geometry."""

import numpy as np
import pytest
from scipy.special import sph_harm_y

import cvkern

F32, U8 = np.float32, np.uint8
LIGHTS = np.array([[0.3, -0.2, 0.9], [-0.8, 0.1, 0.4], [0.1, 0.9, -0.2]])


def hill(shape=(12, 17), seed=3):
    """Return depth with slopes of up to about one, and a hole."""
    rng = np.random.default_rng(seed)
    y, x = np.indices(shape)
    depth = 3 * np.sin(x / 3) + 2 * np.cos(y / 2.5 + 1) + rng.normal(0, 0.1, shape)
    depth[4:6, 5:9] = np.nan
    return depth


def slopes(depth):
    """Return central differences, one-sided beside what is not finite, as the docstring says."""
    found = []
    for axis in (1, 0):
        d = np.moveaxis(np.pad(depth, 1, constant_values=np.nan), axis + 0, -1)
        before, here, after = d[..., :-2], d[..., 1:-1], d[..., 2:]
        s = np.where(np.isfinite(after - before), (after - before) / 2, np.nan)
        s = np.where(np.isnan(s), after - here, s)
        s = np.nan_to_num(np.where(np.isnan(s), here - before, s))
        found.append(np.moveaxis(s, -1, axis)[1:-1] if axis else np.moveaxis(s, -1, 0)[:, 1:-1])
    return found


def normals_of(depth):
    a, b = slopes(depth)
    n = np.stack([a, -b, np.ones_like(a)], axis=-1)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    n[~np.isfinite(depth)] = np.nan
    return n


def test_normals(backend):
    depth = hill()
    want = normals_of(depth.astype(F32).astype(float))
    # Slopes of float32 depth of at most 6: a few units of 2^-24 times that.
    np.testing.assert_allclose(cvkern.normals_from_depth(depth), want, rtol=0, atol=2e-6)


@pytest.mark.parametrize("shadows", ["attached", "none"])
def test_directional(backend, shadows):
    depth = hill()
    albedo = np.random.default_rng(1).random(depth.shape)
    images = cvkern.lambertian(depth, LIGHTS, albedo=albedo, shadows=shadows)
    want = np.einsum("yxc,kc->kyx", np.nan_to_num(normals_of(depth)), LIGHTS) * albedo
    want = np.maximum(want, 0) if shadows == "attached" else want
    np.testing.assert_allclose(images, want, rtol=0, atol=3e-6)
    np.testing.assert_array_equal(
        images[0], cvkern.lambertian(depth, LIGHTS[0], albedo=albedo, shadows=shadows)
    )


def harmonics(directions):
    """Return the nine real harmonics by SciPy's complex ones, in the docstring's order."""
    x, y, z = np.moveaxis(directions, -1, 0)
    polar, azimuth = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)

    def real(n, m):
        value = sph_harm_y(n, abs(m), polar, azimuth) * (-1) ** m
        return value.real if m == 0 else np.sqrt(2) * (value.real if m > 0 else value.imag)

    order = [(0, 0), (1, -1), (1, 0), (1, 1), (2, -2), (2, -1), (2, 0), (2, 1), (2, 2)]
    return np.stack([real(n, m) for n, m in order], axis=-1)


def test_sky(backend):
    """A sky of degree 2 gives what its radiance over the hemisphere of a normal sums to."""
    rng = np.random.default_rng(4)
    sky = np.array([4, *rng.normal(0, 0.3, 8)])
    n = 400
    z, turn = (np.arange(n) + 0.5) / n * 2 - 1, (np.arange(2 * n) + 0.5) / n * np.pi
    z, turn = np.meshgrid(z, turn, indexing="ij")
    r = np.sqrt(1 - z**2)
    directions = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)
    radiance = harmonics(directions) @ sky
    normals = rng.normal(size=(2, 3, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    cosines = np.maximum(np.einsum("yxc,abc->yxab", normals, directions), 0)
    want = (cosines * radiance).mean(axis=(2, 3)) * 4 * np.pi / np.pi
    # The midpoint rule has n^-2 times the bend of the integrand.
    np.testing.assert_allclose(cvkern.lambertian(normals, sky), want, atol=1e-4)


@pytest.mark.parametrize("sky", [False, True])
@pytest.mark.parametrize("shadows", ["attached", "none"])
@pytest.mark.parametrize("kind", ["normals", "depth"])
def test_gradients_by_differences(backend, kind, shadows, sky):
    """The dot product of gradient and any change is the loss's difference, in float64."""
    rng = np.random.default_rng(5)
    depth = hill()
    surface = normals_of(depth) if kind == "normals" else depth
    lights = rng.normal(0, 1, (2, 9)) if sky else LIGHTS
    albedo = 0.2 + rng.random(depth.shape)
    grad = rng.normal(size=(len(lights), *depth.shape))
    found = cvkern.lambertian_backward(grad, surface, lights, albedo=albedo, shadows=shadows)

    def loss(surface, lights, albedo):
        n = np.nan_to_num(normals_of(surface) if surface.ndim == 2 else surface)
        there = np.isfinite(depth)
        if sky:
            x, y, z = np.moveaxis(n, -1, 0)
            basis = _sky_basis(x, y, z)
            e = np.einsum("yxc,kc->kyx", basis, lights)
        else:
            e = np.einsum("yxc,kc->kyx", n, lights)
        e = np.maximum(e, 0) if shadows == "attached" else e
        return (grad * e * albedo * there).sum()

    for field, value in (("surface", surface), ("lights", lights), ("albedo", albedo)):
        change = rng.normal(size=value.shape)
        arguments = {"surface": surface, "lights": lights, "albedo": albedo}
        h = 1e-6
        up = loss(**{**arguments, field: value + h * change})
        down = loss(**{**arguments, field: value - h * change})
        want = (up - down) / (2 * h)
        got = np.nansum(getattr(found, field).astype(float) * change)
        # Sums of 400 float32 terms of about 1; a change of sign within h is rare.
        assert got == pytest.approx(want, rel=2e-4, abs=2e-3), field


def _sky_basis(x, y, z):
    """Return the factors of a sky's coefficients, for normals of any length."""
    a = np.sqrt(1 / (4 * np.pi))
    b, c = 2 / 3 * np.sqrt(3 / (4 * np.pi)), 1 / 4 * np.sqrt(15 / (4 * np.pi))
    d = 1 / 4 * np.sqrt(5 / (16 * np.pi))
    e = 1 / 4 * np.sqrt(15 / (16 * np.pi))
    return np.stack(
        [a + 0 * x, b * y, b * z, b * x, c * x * y, c * y * z, d * (3 * z**2 - 1), c * x * z,
         e * (x**2 - y**2)], axis=-1,
    )  # fmt: skip


def test_a_wall_casts_a_shadow_as_long_as_it_is_high(backend):
    depth = np.full((5, 40), 10.0)
    depth[:, 10] = 4  # a wall, six pixels high
    for slope, length in ((1.0, 6), (0.5, 12)):
        right = cvkern.lambertian(depth, [-1, 0, slope], shadows="cast")[2]
        free = cvkern.lambertian(depth, [-1, 0, slope])[2]
        dark = (right == 0) & (free > 0)
        # The pixel beside the wall is on its slope; the last one is where the ray grazes the top.
        assert 11 + length - 1 <= np.flatnonzero(dark).max() + 1 <= 11 + length
        assert not dark[12 + length :].any()
        assert dark[12 : 10 + length].all()
        assert not dark[:10].any()
    flat = cvkern.lambertian(np.zeros((4, 6)), [[-1, 0.3, 0.2], [0, 0, 1]], shadows="cast")
    assert (flat > 0).all()


def test_cast_shadows_against_every_ray(backend):
    """A pixel is dark where any point of its ray, sampled finely, is below the surface."""
    depth = np.nan_to_num(hill((14, 18)) * 2)
    light = np.array([0.7, 0.4, 0.5])
    lit = cvkern.lambertian(depth, light, shadows="cast") > 0
    attached = cvkern.lambertian(depth, light) > 0
    wrong = 0
    for y in range(14):
        for x in range(18):
            s = np.arange(1, 40) / 0.7
            u, v, z = x + s * 0.7, y - s * 0.4, depth[y, x] - s * 0.5
            inside = (u >= 0) & (u <= 17) & (v >= 0) & (v <= 13)
            u, v, z = u[inside], v[inside], z[inside]
            j, i = np.round(u).astype(int), np.floor(v).astype(int)
            below = np.minimum(i + 1, 13)
            seen = depth[i, j] + (v - i) * (depth[below, j] - depth[i, j])
            blocked = (seen < z - 1e-3).any()
            wrong += lit[y, x] != (attached[y, x] and not blocked)
    assert wrong <= 1  # a ray that leaves the image on its very border


def test_gradients_with_cast_shadows_are_those_of_what_is_lit(backend):
    depth = np.full((5, 40), 10.0)
    depth[:, 10] = 4
    grad = np.ones(depth.shape)
    found = cvkern.lambertian_backward(grad, depth, [-1, 0, 1], shadows="cast")
    image = cvkern.lambertian(depth, [-1, 0, 1], shadows="cast")
    np.testing.assert_array_equal(found.albedo, image)


def test_gradients_of_infinite_albedos_are_no_reason_for_a_warning(backend):
    albedo = np.ones((5, 4), F32)
    albedo[1, 1] = albedo[2, 2] = np.inf
    grad = np.ones((5, 4))
    grad[2, 2] = -1
    found = cvkern.lambertian_backward(grad, 0 * grad, [0, 0, 1], albedo=albedo)
    assert not np.isfinite(found.lights).all()


def test_a_mesh_of_a_depth_map_looks_like_it(backend):
    y, x = np.indices((30, 40))
    depth = 20 - 0.01 * (x - 20.0) ** 2 - 0.02 * (y - 12.0) ** 2
    depth[:, 30:] = np.nan
    mesh = cvkern.mesh_from_depth(depth)
    assert mesh.faces.shape == (2 * 29 * 29, 3)
    image = cvkern.lambertian(mesh, LIGHTS[:2], shadows="cast", shape=(30, 40))
    want = cvkern.lambertian(depth, LIGHTS[:2], shadows="cast")
    # Away from the border, where the two take other neighbours; the bend is at most 0.04.
    np.testing.assert_allclose(image[:, 2:-2, 2:28], want[:, 2:-2, 2:28], atol=0.01)
    assert (image[:, :, 30:] == 0).all()
    near = cvkern.Mesh(
        np.array([[0, 0, 0], [9, 0, 0], [0, -9, 0], [0, 0, 5], [4, 0, 5], [0, -4, 5]], F32),
        np.array([[0, 2, 1], [3, 4, 5]]),
    )
    # The nearer triangle faces away: the light in front does not reach what is seen of it.
    seen = cvkern.lambertian(near, [0, 0, 1], shape=(10, 10))
    y, x = np.indices((10, 10))
    np.testing.assert_array_equal(seen, (x + y <= 9) & (x + y > 4))


@pytest.mark.parametrize("name", ["shade", "cast"])
def test_same_bits(all_kernels, name):
    depth, lights = hill().astype(F32), LIGHTS.astype(F32)
    results = []
    for kernels in all_kernels:
        normals = kernels("shading.rendering.normals", depth, out=[((12, 17, 3), F32)])
        lit = kernels("shading.rendering.cast", depth, lights, -4.0, out=[((3, 12, 17), U8)])
        images = kernels(
            "shading.rendering.shade", normals, lights, np.ones((12, 17), F32), lit, True,
            out=[((3, 12, 17), F32)],
        )  # fmt: skip
        results.append(lit if name == "cast" else images)
    np.testing.assert_array_equal(*results)


FLAT = np.zeros((4, 5))


@pytest.mark.parametrize(
    ("message", "surface", "lights", "options"),
    [
        ("lights must have shape (K, 3) or (K, 9), got (2,)", FLAT, [1, 2], {}),
        ("lights must be finite, got others", FLAT, [1, 2, np.nan], {}),
        ("shape must be given for a mesh, got None", (FLAT[:, :3], [[0, 1, 2]]), [0, 0, 1], {}),
        ("shape must be None for normals and depth, got (4, 5)", FLAT, [0, 0, 1],
         {"shape": (4, 5)}),
        ("surface must have shape (H, W) or (H, W, 3), got (4, 5, 2)", np.zeros((4, 5, 2)),
         [0, 0, 1], {}),
        ("shadows must be 'attached' or 'none' for normals or harmonics, got 'cast'", FLAT,
         np.ones(9), {"shadows": "cast"}),
        ("albedo must have shape (4, 5), got (5, 4)", FLAT, [0, 0, 1], {"albedo": FLAT.T}),
        ("albedo must be >= 0 and finite, got -1", FLAT, [0, 0, 1], {"albedo": -1}),
        ("faces must be indices of 4 vertices, got 0 to 9", (FLAT[:, :3], [[0, 1, 9]]),
         [0, 0, 1], {"shape": (4, 5)}),
    ],
)  # fmt: skip
def test_errors(no_kernel_runs, message, surface, lights, options):
    with pytest.raises(ValueError) as info:  # noqa: PT011  (the whole message is compared)
        cvkern.lambertian(surface, lights, **options)
    assert str(info.value) == message
