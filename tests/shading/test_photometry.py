"""Photometric stereo against NumPy, on known surfaces, and where nothing can be told."""

import numpy as np
import pytest

import cvkern
from tests.on_cuda import assert_equal_bits, give, take
from tests.shading import data
from tests.shading import reference_photometry as reference

F32, U8, U16 = np.float32, np.uint8, np.uint16
METHODS = ["trimmed", "l1", "sparse_bayes", "consensus"]


def lamps(count, seed=0):
    rng = np.random.default_rng(seed)
    lights = np.hstack([rng.uniform(-0.7, 0.7, (count, 2)), np.ones((count, 1))])
    return lights / np.linalg.norm(lights, axis=1, keepdims=True)


def scene(shape=(7, 11), count=14, seed=2):
    """Return images of random normals with shadows, highlights and noise."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(0, 0.5, (*shape, 3)) + np.array([0, 0, 1])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    lights = lamps(count) * rng.uniform(0.5, 1.5, (count, 1))
    images = cvkern.lambertian(normals, lights, albedo=0.3 + rng.random(shape))
    images += rng.normal(0, 0.01, images.shape).astype(F32)
    images[rng.random(images.shape) < 0.1] *= F32(1.8)
    return np.maximum(images, 0), lights, normals


def test_ranks(kernels):
    images = scene()[0].round(1)
    images[3, 2, 4], images[5, 2, 5], images[6, 2, 6] = np.nan, np.inf, -np.inf
    mask = np.ones(images.shape[1:], U8)
    mask[5:, 3:] = 0
    scales = np.random.default_rng(1).uniform(0.5, 2, len(images)).astype(F32)
    got = kernels("shading.photometry.rank", images, scales, mask, 0.8, out=[(images.shape, U16)])
    assert (got[:, mask == 0] == 65535).all()
    got, images = got[:, :5], images[:, :5]
    part = np.isfinite(images) & (images < F32(0.8))
    for y, x in np.ndindex(*images.shape[1:]):
        own = images[:, y, x]
        want = reference.ranks(own, float(F32(0.8)), scales)
        np.testing.assert_array_equal(got[:, y, x], np.where(want < 0, 65535, want))
    assert (got[~part] == 65535).all()


def test_least_squares(backend):
    images, lights, _ = scene((9, 70), 5)
    found = cvkern.photometric_stereo(images, lights, method="least_squares")
    s = np.linalg.lstsq(lights, images.reshape(5, -1).astype(float), rcond=None)[0]
    albedo = np.linalg.norm(s, axis=0)
    off = images.reshape(5, -1) - np.maximum(lights @ s, 0)
    # Five products of float32 and the inverse, whose entries are below 2.
    np.testing.assert_allclose(found.albedo.ravel(), albedo, atol=2e-6)
    np.testing.assert_allclose(found.normals.reshape(-1, 3), (s / albedo).T, atol=2e-5)
    np.testing.assert_allclose(found.residual.ravel(), np.sqrt((off**2).mean(axis=0)), atol=2e-6)


def test_least_squares_have_the_same_bits(all_kernels):
    images, lights, _ = scene((6, 300), 5)
    images[0, 0, 0] = np.nan
    wide = np.hstack([lights, np.ones((5, 1))]).astype(F32)
    results = [
        kernels(
            "shading.photometry.solve", images, np.linalg.pinv(lights).astype(F32), wide,
            np.ones((6, 300), U8), out=[((6, 300, 3), F32), ((6, 300), F32), ((6, 300), F32)],
        )
        for kernels in all_kernels
    ]  # fmt: skip
    for a, b in zip(*results, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("method", METHODS)
def test_rules(backend, method):
    """The same as NumPy's, a pixel at a time; a rest of a group of pixels, too."""
    images, lights, _ = scene()
    images[4, 1, 1] = np.nan
    found = cvkern.photometric_stereo(images, lights, method=method, saturation=1.4)
    for y, x in np.ndindex(*images.shape[1:]):
        own = images[:, y, x].astype(float)
        normal, albedo, residual = reference.pixel(own, lights.astype(F32), method, 1.4)
        # Both are float64, but sums in another order are weighed by their inverse; results and
        # the variances of sparse Bayes are float32.
        tolerance = 2e-3 if method == "sparse_bayes" else 2e-5
        np.testing.assert_allclose(found.normals[y, x], normal, atol=tolerance)
        assert found.albedo[y, x] == pytest.approx(albedo, abs=tolerance)
        assert found.residual[y, x] == pytest.approx(residual, abs=tolerance)


def test_few_lit_images(backend):
    """Fewer than three lit images tell no normal, so all take part in a consensus."""
    images, lights, _ = scene(count=5)
    images[:2] += 0.1
    images[2:, :, 3:] = 0
    found = cvkern.photometric_stereo(images, lights)
    for y, x in np.ndindex(*images.shape[1:]):
        own = images[:, y, x].astype(float)
        normal, albedo, _ = reference.pixel(own, lights.astype(F32), "consensus")
        np.testing.assert_allclose(found.normals[y, x], normal, atol=2e-5)
        assert found.albedo[y, x] == pytest.approx(albedo, abs=2e-5)


@pytest.mark.parametrize("method", ["least_squares", *METHODS])
def test_a_matt_surface_is_found_as_it_is(backend, method):
    y, x = np.indices((24, 24)) - 11.5
    normals = cvkern.normals_from_depth((x**2 + y**2) / 60)
    lights = lamps(12) * np.linspace(0.5, 2, 12)[:, None]
    images = cvkern.lambertian(normals, lights, albedo=0.7, shadows="none")
    assert images.min() > 0
    found = cvkern.photometric_stereo(images, lights, method=method)
    assert data.apart(found.normals, normals, np.ones((24, 24), bool)) < 0.02
    # Three images may outweigh the others in L1, where rounding looks like an outlier.
    np.testing.assert_allclose(found.albedo, 0.7, rtol=1e-3 if method == "l1" else 1e-4)
    assert found.residual.max() < (1e-3 if method == "l1" else 1e-5)


def test_real_and_rendered_surfaces(backend):
    """The default is at most what the best of other methods is on each, and so on a third."""
    images, lights, mask, normals = data.ball()
    for method, most in (("least_squares", 4.62), ("trimmed", 2.41), ("consensus", 2.1)):
        found = cvkern.photometric_stereo(images, lights, mask=mask, method=method)
        assert data.apart(found.normals, normals, mask) < most
    images, lights, mask, normals = data.bunny()
    for method, most in (("least_squares", 4.11), ("trimmed", 2.61), ("consensus", 2.7)):
        found = cvkern.photometric_stereo(images, lights, mask=mask, method=method)
        assert data.apart(found.normals, normals, mask) < most
    lights = cvkern.lights_from_sphere(*data.sphere("chrome"))
    images, mask = data.sphere("gray")
    found = cvkern.photometric_stereo(images, lights, mask=mask)
    assert data.apart(found.normals, data.round_normals(mask), mask) < 5.8


def test_lights_near_by(backend):
    """A cap under four lamps close to it; far lights of the same places are wrong by degrees."""
    y, x = np.indices((33, 41))
    depth = ((x - 20.0) ** 2 + (y - 16.0) ** 2) / 80
    depth -= depth.mean()
    normals = cvkern.normals_from_depth(depth)
    rng = np.random.default_rng(0)
    places = np.array([[20, -16, 0]]) + [
        [60 * np.cos(t), 60 * np.sin(t), 50 + 10 * rng.random()] for t in np.arange(6) + 0.1
    ]
    strengths = 3000 + 1000 * rng.random(6)
    images = []
    for place, strength in zip(places, strengths, strict=True):
        to = place - np.stack([x, -y, -depth], axis=-1)
        cosines = (to * normals).sum(axis=-1)
        images.append(0.5 * strength * np.maximum(cosines, 0) / np.linalg.norm(to, axis=-1) ** 3)
    lights = np.hstack([places, strengths[:, None]])
    everywhere = np.ones(depth.shape, bool)
    found = cvkern.photometric_stereo(images, lights, near=True)
    assert data.apart(found.normals, normals, everywhere) < 0.5
    np.testing.assert_allclose(found.albedo, 0.5, rtol=0.03)
    far = cvkern.photometric_stereo(images, places - [[20, -16, 0]])
    assert data.apart(far.normals, normals, everywhere) > 3


@pytest.mark.parametrize("method", ["least_squares", "trimmed", "consensus"])
def test_captured(backend, method):
    """A replay follows the images and the mask."""
    images, lights, _ = scene()
    mask = np.arange(77).reshape(7, 11) % 3 > 0
    for masked in (None, mask):
        replay = cvkern.capture(
            cvkern.photometric_stereo, images, lights, method=method, mask=masked
        )
        images[...] = scene(seed=5)[0]
        mask[...] = ~mask
        want = cvkern.photometric_stereo(images, lights, method=method, mask=masked)
        for a, b in zip(replay(), want, strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("count", [14, 100, 250])
def test_captured_on_cuda(gpu, count):
    """Values fit into registers for up to 192 images."""
    images, lights, _ = scene((37, 53), count)
    mask = np.arange(images[0].size).reshape(37, 53) % 3 > 0
    for method in ("least_squares", "trimmed", "consensus", "l1"):
        given = give("torch", images[:14]) if method == "consensus" else give("torch", images)
        own = lights[: len(given)]
        replay = cvkern.capture(
            cvkern.photometric_stereo, given, own, method=method, mask=give("torch", mask)
        )
        want = cvkern.photometric_stereo(take(given), own, method=method, mask=mask)
        for a, b in zip(replay(), want, strict=True):
            if method == "least_squares":
                assert_equal_bits((take(a),), (b,))
            else:
                # Sums of float32, which matter where four images or fewer decide on weights.
                off = np.abs(take(a) - b)
                np.testing.assert_array_equal(np.isnan(off), np.isnan(b))
                assert method == "l1" or np.nanquantile(off, 0.99) < 2e-5
                assert np.nanmax(off) < 5e-3


def test_where_nothing_can_be_told(backend):
    lights = lamps(5)
    images = cvkern.lambertian(np.full((4, 6, 3), [0, 0, 1.0]), lights)
    images[:, 0] = 0  # black
    images[:, 1] = 9  # saturated
    images[:3, 2] = np.nan
    images[:2, 3, :3] = np.nan
    for method in ("consensus", "least_squares"):
        found = cvkern.photometric_stereo(images, lights, method=method, saturation=9)
        assert np.isnan(found.normals[:3]).all()
        assert (found.albedo[:3] == 0).all()
        assert (found.residual[:3] == 0).all()
        np.testing.assert_allclose(found.normals[3], [[0, 0, 1]] * 6, atol=1e-4)
    found = cvkern.photometric_stereo(images, lights, method="least_squares")
    assert np.isnan(found.normals[0]).all()
    assert np.isnan(found.normals[3, :3]).all()
    assert np.isfinite(found.normals[3, 3:]).all()
    mask = np.zeros((4, 6))
    mask[3, 4] = 1
    found = cvkern.photometric_stereo(images, lights, mask=mask)
    assert np.isfinite(found.normals).all(axis=-1).sum() == 1


@pytest.mark.parametrize("near", [False, True])
def test_three_images_have_one_solution(backend, near):
    """Where one of three was dark, `consensus` once left it out, and two tell no normal."""
    lights = np.array([[0.5, 0.1, 0.8], [-0.4, 0.5, 0.7], [0.1, -0.6, 0.9]])
    lights *= 1e4 if near else 1  # so far away that lights of one strength are the same everywhere
    images = np.random.default_rng(3).uniform(0.2, 1, (3, 5, 6))
    images[0, :2] = 0
    found = cvkern.photometric_stereo(images, lights, near=near)
    directions = lights / np.linalg.norm(lights, axis=1, keepdims=True) if near else lights
    sizes = np.linalg.norm(lights, axis=1) ** 2 if near else np.ones(3)
    want = np.linalg.solve(directions, (images * sizes[:, None, None]).reshape(3, -1)).T
    want /= np.linalg.norm(want, axis=1, keepdims=True)
    # Pixels are within 8 of the middle, which turns lights at 1e4 by less than 1e-3.
    np.testing.assert_allclose(found.normals.reshape(-1, 3), want, atol=4e-3 if near else 1e-5)


def test_lights_of_a_mirror():
    """A sphere of which each pixel shows the lights around the direction that it mirrors."""
    y, x = np.indices((81, 91))
    nx, ny = (x - 47) / 30, (39 - y) / 30
    mask = nx**2 + ny**2 <= 1
    n = np.stack([nx, ny, np.sqrt(np.maximum(1 - nx**2 - ny**2, 0))], axis=-1)
    seen = 2 * n[..., 2:] * n - [0, 0, 1]
    lights = lamps(6, seed=3)
    images = np.exp(200 * (np.einsum("yxc,kc->kyx", seen, lights) - 1)) * mask
    found = cvkern.lights_from_sphere(images, mask)
    # The middle of a highlight's pixels is within half a pixel, which turns the mirrored ray by
    # twice that over the radius.
    assert np.degrees(np.arccos((found * lights).sum(axis=1))).max() < np.degrees(1 / 30) + 0.5


def between(found, true):
    """Return the angles between vectors, in degrees."""
    sizes = np.linalg.norm(found, axis=1) * np.linalg.norm(true, axis=1)
    return np.degrees(np.arccos(np.clip((found * true).sum(axis=1) / sizes, -1, 1)))


@pytest.mark.parametrize("equal", ["lights", "albedo"])
def test_lights_of_nobody(backend, equal):
    y, x = np.indices((40, 40)) - 19.5
    depth = (x**2 + 1.5 * y**2) / 80 + 2 * np.sin(x / 4) * np.cos(y / 5)
    true = lamps(6) if equal == "lights" else lamps(6) * np.linspace(0.7, 1.4, 6)[:, None]
    albedo = np.where((x > 0) & (equal == "lights"), 0.5, 0.9)
    images = cvkern.lambertian(depth, true, albedo=albedo)
    found = cvkern.estimate_lights(images, equal=equal)
    assert between(found, true).max() < 1.5
    assert np.linalg.norm(found, axis=1).mean() == pytest.approx(1)
    sizes = np.linalg.norm(found, axis=1) / np.linalg.norm(true, axis=1)
    np.testing.assert_allclose(sizes, sizes.mean(), rtol=0.03)
    rng = np.random.default_rng(0)
    noisy = images + rng.normal(0, 0.01, images.shape)
    found = cvkern.estimate_lights(noisy, equal=equal)
    assert between(found, true).max() < 6
    with pytest.raises(ValueError, match="got noise, gloss or too flat a surface"):
        cvkern.estimate_lights(images + rng.normal(0, 0.3, images.shape), equal=equal)


def test_shadows_tell_nothing_of_the_lights():
    """A tenth of all values are shadows; taken as they are, lights are off by 7 degrees."""
    y, x = np.indices((40, 40)) - 19.5
    depth = (x**2 + 1.5 * y**2) / 20 + 2 * np.sin(x / 4) * np.cos(y / 5)
    images = cvkern.lambertian(depth, lamps(8, seed=1), albedo=0.9)
    assert 0.1 < (images == 0).mean() < 0.11
    found = cvkern.estimate_lights(images)
    assert between(found, lamps(8, seed=1)).max() < 0.9  # measured: 0.78


def ring(count, slant, spread=0.0):
    """Return lights about the view."""
    turns = np.arange(count) * 2 * np.pi / count
    slants = np.radians(slant + np.random.default_rng(0).normal(0, spread, count))
    return np.stack(
        [np.sin(slants) * np.cos(turns), np.sin(slants) * np.sin(turns), np.cos(slants)], axis=1
    )


@pytest.mark.parametrize("spread", [0, 2])
def test_a_ring_of_lights_tells_no_depth(spread):
    """Their strengths are equal at any flattening: the answer was off by 39 degrees."""
    y, x = np.indices((40, 40)) - 19.5
    depth, true = (x**2 + y**2) / 400, ring(8, 40, spread)
    with pytest.raises(ValueError, match=r"got lights on a ring .* equal='albedo'"):
        cvkern.estimate_lights(cvkern.lambertian(depth, true))
    bent = (x**2 + 1.5 * y**2) / 80 + 2 * np.sin(x / 4) * np.cos(y / 5)
    images = cvkern.lambertian(bent, true)
    assert between(cvkern.estimate_lights(images, equal="albedo"), true).max() < 0.5
    more = np.vstack([true, [0, 0, 1]])
    found = cvkern.estimate_lights(cvkern.lambertian(bent, more))
    assert between(found, more).max() < 0.5


@pytest.mark.parametrize("equal", ["lights", "albedo"])
def test_noise_that_hides_a_flat_surface(equal):
    """Its curvature is hidden, and the answers were off by more than 100 degrees."""
    y, x = np.indices((40, 40)) - 19.5
    depth = (x**2 + 1.5 * y**2) / 800 + 0.2 * np.sin(x / 4) * np.cos(y / 5)
    images = cvkern.lambertian(depth, lamps(6), albedo=0.9)
    assert between(cvkern.estimate_lights(images, equal=equal), lamps(6)).max() < 0.1
    noisy = images + np.random.default_rng(0).normal(0, 0.005, images.shape)
    with pytest.raises(ValueError, match=r"too flat a surface|a surface too flat for its noise"):
        cvkern.estimate_lights(noisy, equal=equal)


def test_lights_of_nobody_on_real_and_rendered_surfaces():
    for images, true, mask, _ in (data.ball(), data.bunny()):
        found = cvkern.estimate_lights(images, mask=mask)
        assert between(found, true).mean() < 8


IMAGES, LIGHTS = np.ones((4, 3, 5)), lamps(4)
FLAT = np.array([[0, 0, 1], [1, 0, 1], [-1, 0, 1], [0.5, 0, 2]])


@pytest.mark.parametrize(
    ("message", "images", "lights", "options"),
    [
        ("images must be 3 to 1024, got 1", IMAGES[:1], LIGHTS[:1], {}),
        ("images must have shape (K, H, W), got (4, 3, 5, 3): take the mean of the channels of "
         "colour images", np.ones((4, 3, 5, 3)), LIGHTS, {}),
        ("lights must have shape (4, 3), got (3, 3)", IMAGES, LIGHTS[:3], {}),
        ("lights must be finite, got others", IMAGES, LIGHTS * np.nan, {}),
        ("lights must not lie in one plane through the origin, got such lights", IMAGES, FLAT, {}),
        ("lights must have shape (4, 3) or (4, 4), got (4, 2)", IMAGES, LIGHTS[:, :2],
         {"near": True}),
        ("mask must not be 0 everywhere, got such a mask", IMAGES, LIGHTS,
         {"mask": np.zeros((3, 5))}),
        ("mask must have shape (3, 5), got (5, 3)", IMAGES, LIGHTS, {"mask": np.ones((5, 3))}),
        ("saturation must be > 0, got 0", IMAGES, LIGHTS, {"saturation": 0}),
    ],
)  # fmt: skip
def test_errors(no_kernel_runs, message, images, lights, options):
    with pytest.raises(ValueError) as info:  # noqa: PT011  (the whole message is compared)
        cvkern.photometric_stereo(images, lights, **options)
    assert str(info.value) == message


@pytest.mark.parametrize(
    ("message", "function", "arguments"),
    [
        ("images must show a light on the sphere, got none in image 2", "lights_from_sphere",
         (IMAGES * np.array([1, 1, 0, 1])[:, None, None], np.ones((3, 5)))),
        ("mask must not be 0 everywhere, got such a mask", "lights_from_sphere",
         (IMAGES, np.zeros((3, 5)))),
        ("images must be at least 4, got 3", "estimate_lights", (IMAGES[:3],)),
        ("images must have three independent lights, got fewer", "estimate_lights", (IMAGES,)),
    ],
)  # fmt: skip
def test_errors_of_lights(message, function, arguments):
    with pytest.raises(ValueError) as info:  # noqa: PT011  (the whole message is compared)
        getattr(cvkern, function)(*arguments)
    assert str(info.value) == message
