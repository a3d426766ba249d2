"""Contrast: scikit-image's equalisation, and retinex of SciPy's Gaussians."""

import numpy as np
import pytest
from scipy import sparse
from scipy.ndimage import gaussian_filter
from skimage import data, exposure

import cvkern

PHOTO = data.camera()[100:197, 150:261]
COLOURS = data.astronaut()[60:140, 180:270]


@pytest.mark.parametrize(
    "image",
    [PHOTO, PHOTO.astype(np.uint16) * 211, (PHOTO / 255).astype(np.float32) ** 2, COLOURS],
    ids=["uint8", "uint16", "float", "colours"],
)
def test_equalize_hist_is_scikit_image(backend, image):
    want = exposure.equalize_hist(image.reshape(len(image), -1)).astype(np.float32)
    want = want.reshape(image.shape)
    # For floats, scikit-image rounds the curve to float32 before it reads between its points.
    rounding = 2e-7 if image.dtype == np.float32 else 0
    np.testing.assert_allclose(cvkern.equalize_hist(image), want, rtol=0, atol=rounding)


@pytest.mark.parametrize(
    ("image", "options"),
    [
        (PHOTO, {}),
        (PHOTO, {"clip_limit": 0.0, "kernel_size": (40, 23), "nbins": 64}),
        (PHOTO.astype(np.uint16) * 211, {"clip_limit": 0.03, "kernel_size": 17}),
        ((PHOTO / 255).astype(np.float32) ** 2, {"clip_limit": 0.5}),
        (PHOTO[:9, :5], {"kernel_size": 20}),
    ],
)
def test_adapthist_is_scikit_image(backend, image, options):
    want = exposure.equalize_adapthist(image, **options)
    got = cvkern.equalize_adapthist(image, **options)
    np.testing.assert_allclose(got, want, rtol=0, atol=2e-7)


def test_adapthist_of_colours(backend):
    want = exposure.equalize_adapthist(COLOURS)
    got = cvkern.equalize_adapthist(COLOURS)
    # The new tone, its product and the quotient are rounded to float32, by 6e-8 of 1 each.
    np.testing.assert_allclose(got, want, rtol=0, atol=2e-7)


@pytest.mark.parametrize("image", [PHOTO, PHOTO.astype(np.uint16) * 211, PHOTO / 255, COLOURS])
def test_bytes_are_the_nearest(backend, image):
    for equalize in (cvkern.equalize_hist, cvkern.equalize_adapthist):
        got = equalize(image, dtype="uint8")
        assert got.dtype == np.uint8
        # A value in the middle between two bytes may go to either by a rounding of float32.
        assert np.abs(got - 255.0 * equalize(image)).max() < 0.5 + 1e-4


def test_many_pixels_are_counted_by_several_threads(backend, monkeypatch):
    """Slabs of a large image have histograms of their own; a table holds the sums."""
    monkeypatch.setenv("CVKERN_NUM_THREADS", "3")
    rng = np.random.default_rng(6)
    for dtype, top in ((np.uint8, 256), (np.uint16, 4000)):
        image = rng.integers(0, top, (500, 701)).astype(dtype)
        want = np.cumsum(np.bincount(image.ravel(), minlength=top))[image] / image.size
        np.testing.assert_array_equal(cvkern.equalize_hist(image), want.astype(np.float32))
    want = exposure.equalize_adapthist(image, (50, 64), 0.02)
    np.testing.assert_allclose(
        cvkern.equalize_adapthist(image, (50, 64), 0.02), want, rtol=0, atol=2e-7
    )


def test_both_sets_have_the_same_bits():
    answers = []
    for kernels in ("warp", "taichi"):
        with cvkern.use(kernels):
            answers.append(
                (
                    cvkern.equalize_adapthist(COLOURS),
                    cvkern.equalize_adapthist(COLOURS, dtype="uint8"),
                    cvkern.equalize_hist(COLOURS / 255.0),
                    cvkern.equalize_hist(COLOURS / 255.0, dtype="uint8"),
                )
            )
    for first, second in zip(*answers, strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("value", [0, 90])
def test_one_brightness(backend, value):
    flat = np.full((12, 10), value, np.uint8)
    want = exposure.equalize_adapthist(flat)
    np.testing.assert_array_equal(cvkern.equalize_adapthist(flat), want)
    np.testing.assert_array_equal(cvkern.equalize_hist(flat), 1)
    np.testing.assert_array_equal(
        cvkern.equalize_hist(flat / 255), exposure.equalize_hist(flat / 255)
    )
    np.testing.assert_allclose(cvkern.retinex(flat, 3.0), 0, atol=1e-6)


@pytest.mark.parametrize(
    "values", [(-3e38, 3e38, 0), (1e30, 1e30, 1e30), (1, 1 + 2**-23, 1), (0, 1e-44, 0)]
)
def test_equalize_hist_of_values_that_float32_cannot_divide(backend, values):
    """NumPy refuses such bins in float32; in float64 there are some for each span."""
    image = np.array([values], np.float32)
    got = cvkern.equalize_hist(image)
    low, high = float(image.min()), float(image.max())
    if low == high:
        want = np.full((1, 3), 0.5)  # the middle of one step
    else:
        edges = np.linspace(low, high, 257)
        counts = np.histogram(image.astype(np.float64), edges)[0]
        want = np.interp(image, (edges[1:] + edges[:-1]) / 2, np.cumsum(counts) / 3)
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-7)


def test_retinex(backend):
    image = COLOURS.astype(np.float64)
    want = np.zeros(image.shape)
    for sigma in (2.0, 9.0):
        around = gaussian_filter(image, (sigma, sigma, 0))
        want += np.log((image + 1) / (around + 1)) / 2
    # Along both axes, 17 and 73 products in float32: sums are off by 2e-6 and 9e-6 at most.
    np.testing.assert_allclose(cvkern.retinex(COLOURS, (2.0, 9.0)), want, atol=1e-5)
    np.testing.assert_allclose(cvkern.retinex(COLOURS / 255, (2.0, 9.0)), want, atol=1e-5)


def test_retinex_takes_slow_light_out(backend):
    paint = np.random.default_rng(0).uniform(0.3, 0.9, (60, 60))
    lit = paint * np.linspace(0.2, 1.0, 60)
    plain, found = (cvkern.retinex(i, 4.0, low=1e-6)[8:-8, 8:-8] for i in (paint, lit))
    assert np.corrcoef(plain.ravel(), found.ravel())[0, 1] > 0.99


@pytest.mark.parametrize("shape", [(24, 31), (1, 9), (17, 20, 3)])
def test_gradients_solve_poissons_equation(backend, shape):
    """The least squares of all steps, by SciPy, of mean 0; the solver's tolerance is 1e-5."""
    image = np.random.default_rng(3).uniform(0.05, 1, shape).astype(np.float32)
    got = cvkern.retinex(image, method="gradients", threshold=0.4, low=0.01)
    height, width = shape[:2]
    along, down = (sparse.csr_array(np.diff(np.eye(n), axis=0)) for n in (width, height))
    edges = sparse.vstack(
        [sparse.kron(sparse.eye(height), along), sparse.kron(down, sparse.eye(width))]
    )
    for k in range(int(np.prod(shape[2:]))):
        logs = np.log(image.reshape(height, width, -1)[..., k].astype(float) + 0.01)
        steps = edges @ logs.ravel()
        steps[np.abs(steps) <= 0.4] = 0
        want = sparse.linalg.lsqr(edges, steps, atol=1e-12, btol=1e-12)[0]
        found = got.reshape(height, width, -1)[..., k].ravel()
        np.testing.assert_allclose(found, want - want.mean(), atol=2e-4)


def test_gradients_tell_paint_from_light(backend):
    """Fields of paint under light that falls to a seventh: the paint, without the light."""
    rng = np.random.default_rng(4)
    paint = np.kron(rng.uniform(0.2, 0.9, (5, 7)), np.ones((12, 12)))
    y, x = np.indices(paint.shape)
    lit = paint * np.exp(-0.02 * x - 0.005 * y)
    found = cvkern.retinex(lit, method="gradients", low=1e-6)
    want = np.log(paint) - np.log(paint).mean()
    # Steps of both fields and light are kept whole: on each edge, 0.02 or 0.005 of light is left.
    assert np.abs(found - want).max() < 0.1
    assert np.std(np.log(lit) - np.log(lit).mean() - want) > 0.4


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("image must be of uint8, uint16 or floats, got int32",
         lambda: cvkern.equalize_hist(np.ones((4, 4), np.int32))),
        ("image must be finite in float32, got some values that are not",
         lambda: cvkern.equalize_hist(np.full((4, 4), 1e300))),
        ("dtype must be float32 or uint8, got int8",
         lambda: cvkern.equalize_hist(np.ones((4, 4)), dtype="int8")),
        ("image must be in 0 to 1 if it holds floats, got 2 to 2",
         lambda: cvkern.equalize_adapthist(np.full((4, 4), 2.0))),
        ("image must have shape (H, W) or (H, W, 3), got (4, 4, 2)",
         lambda: cvkern.equalize_adapthist(np.ones((4, 4, 2)))),
        ("sigma must be one or more numbers above 0, got (1, 0)",
         lambda: cvkern.retinex(np.ones((4, 4)), (1, 0))),
        ("method must be one of ('surroundings', 'gradients'), got 'x'",
         lambda: cvkern.retinex(np.ones((4, 4)), method="x")),
        ("threshold must be >= 0 and finite, got -1",
         lambda: cvkern.retinex(np.ones((4, 4)), method="gradients", threshold=-1)),
        ("low must be above 0, got 0", lambda: cvkern.retinex(np.ones((4, 4)), low=0)),
    ],
)  # fmt: skip
def test_errors(message, call):
    with pytest.raises(ValueError) as info:  # noqa: PT011  (the whole message is compared)
        call()
    assert str(info.value) == message
