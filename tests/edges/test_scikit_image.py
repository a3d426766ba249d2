"""Canny against scikit-image, pixel by pixel, and its warnings about unintended calls."""

import inspect
from typing import Any

import numpy as np
import pytest
import scipy.ndimage as ndi
import skimage.data
import skimage.feature
from hypothesis import given
from hypothesis import strategies as st

import cvkern
from tests.calls import MODES, blobs
from tests.edges import reference_canny as reference

pytestmark = pytest.mark.filterwarnings("ignore:no edge was found")
PHOTOGRAPHS = ["camera", "coins", "moon", "page", "text"]


def scikit_image(image, *args, **options):
    return skimage.feature.canny(image, *args, **options)


def ties(image, sigma, low, high, *, mask=None, mode="constant"):
    """Pixels whose answer float32 may decide otherwise, in scikit-image's own float64 steps.

    A comparison of lengths, or of one with a threshold, is in doubt by what float32 rounds: at
    most 2^-18 of the largest value under the window, over both smoothings and 3 x 3 kernels.
    Hysteresis carries a doubt to all that is connected with it.
    """
    values = np.asarray(image, float)
    smooth = reference.blurred(values, sigma, mask, mode)
    dy, dx = (ndi.sobel(smooth, axis=axis) for axis in (0, 1))
    m = np.hypot(dy, dx)
    doubt = 2.0**-18 * np.abs(values).max()
    big = np.maximum(abs(dy), abs(dx))
    back, ahead = reference.beside(m, dy, dx)
    unsure = np.zeros(m.shape, bool)
    for side in (back, ahead):
        unsure |= np.abs(m * big - side) <= doubt * (big + m) * 4
    unsure &= big > 0
    for limit in (low, high):
        unsure |= np.abs(m - limit) <= doubt
    labelled: Any = ndi.label((m >= low - doubt) | unsure, np.ones((3, 3)))
    possible = labelled[0]
    return np.isin(possible, np.unique(possible[unsure])) & (possible > 0)


@pytest.mark.parametrize("name", [*PHOTOGRAPHS, "brick", "grass", "gravel"])
@pytest.mark.parametrize("dtype", ["uint8", "float64", "float32", "uint16"])
def test_photographs_are_scikit_images(backend, name, dtype):
    """At least 99.95 % of the pixels, whatever is asked; every other one hangs on a tie."""
    image = getattr(skimage.data, name)()
    if dtype != "uint8":
        image = (image / 255).astype(dtype) if dtype[0] == "f" else image.astype(dtype) * 257
    full = np.iinfo(dtype).max if image.dtype.kind == "u" else 1
    window = np.zeros(image.shape, bool)
    window[20:-30, 40:-50] = True
    window[90:110, 100:130] = False
    ways: list[Any] = [
        (1.0, None, None, {}),
        (3.0, 10 / 255 * full, 50 / 255 * full, {}),
        (2.0, 0.08 * full, 0.2 * full, {"mode": "reflect"}),
        (1.5, 0.05 * full, 0.3 * full, {"mask": window}),
        (0.0, 0.2 * full, 0.4 * full, {}),
    ]
    for sigma, low, high, options in ways:
        got = cvkern.canny(image, sigma, low, high, **options)
        want = scikit_image(image, sigma, low, high, **options)
        assert want.any()
        assert got.dtype == bool
        assert (got == want).mean() >= 0.9995
        limits = (low or 0.1 * full, high or 0.2 * full)
        assert not ((got != want) & ~ties(image, sigma, *limits, **options)).any()
    for low, high in ((0.7, 0.9), (0.0, 0.985), (0.123, 1.0)):
        got = cvkern.canny(image, 2.0, low, high, None, True)
        want = scikit_image(image, 2.0, low, high, None, True)
        assert (got == want).mean() >= 0.9995


def test_a_call_of_the_gallery(backend):
    coins = skimage.data.coins()
    want = scikit_image(coins, sigma=3, low_threshold=10, high_threshold=50)
    assert want.sum() > 4000
    got = cvkern.canny(coins, sigma=3, low_threshold=10, high_threshold=50)
    np.testing.assert_array_equal(got, want)


def test_the_signature_is_scikit_images():
    ours = inspect.signature(cvkern.canny).parameters
    for name, parameter in inspect.signature(skimage.feature.canny).parameters.items():
        assert ours[name].default == parameter.default
        assert ours[name].kind == parameter.kind
    wanted = [n for n, p in inspect.signature(skimage.feature.canny).parameters.items()
              if p.kind is p.POSITIONAL_OR_KEYWORD]  # fmt: skip
    assert list(ours)[: len(wanted)] == wanted


@given(
    shape=st.tuples(st.integers(1, 40), st.integers(1, 60)),
    sigma=st.sampled_from([0.0, 0.4, 1.0, 3.7]),
    limits=st.tuples(st.floats(0, 60), st.floats(0, 60)),
    mode=st.sampled_from(MODES),
    cval=st.sampled_from([0.0, 100.0]),
    masked=st.booleans(),
    seed=st.integers(0, 2**16),
)
def test_any_blobs_are_scikit_images(backend, shape, sigma, limits, mode, cval, masked, seed):
    """But for ties, which a small picture may have many of: so where there are none."""
    image, (low, high) = blobs(*shape, seed=seed).astype(float), sorted(limits)
    image += np.random.default_rng(seed).normal(0, 2, shape)
    options: dict[str, Any] = {"mode": mode, "cval": cval}
    if masked:
        options["mask"] = blobs(*shape, seed=seed + 1) > 60
    got = cvkern.canny(image, sigma, low, high, **options)
    want = scikit_image(image, sigma, low, high, **options)
    assert (got != want).sum() <= 3 + 0.002 * image.size


def test_of_two_equal_maxima_both_are_kept_as_by_scikit_image(backend):
    """Without smoothing, as the roundings of float64 choose one or the other."""
    step = np.repeat([0.0, 1.0], 8)[None].repeat(9, 0)
    for image in (step, step[:, ::-1], step.T, step[:, ::-1].T):
        got = cvkern.canny(image, 0)
        np.testing.assert_array_equal(got, scikit_image(image, 0))
        assert got.sum() == 2 * (9 - 2)  # none on the frame


@pytest.mark.parametrize("operator", ["gaussian", "scharr"])
def test_other_operators_find_nearly_the_same(backend, operator):
    """At the same thresholds: they share their units."""
    near = np.ones((3, 3), bool)
    for name in ("camera", "coins"):
        image = getattr(skimage.data, name)()
        want = scikit_image(image, 2.0, 20, 50, mode="reflect")
        got = cvkern.canny(image, 2.0, 20, 50, operator=operator, mode="reflect")
        assert (ndi.binary_dilation(want, near) & got).sum() > 0.9 * got.sum()
        assert (ndi.binary_dilation(got, near) & want).sum() > 0.97 * want.sum()


@pytest.mark.parametrize("operator", ["sobel", "scharr", "gaussian"])
def test_masks_and_borders_make_no_edge(backend, operator):
    """Bright pixels beside masked ones, or beside a border of zeros."""
    ramp = 1000.0 + np.add.outer(np.arange(40.0), np.arange(50.0)) / 100
    mask = np.ones(ramp.shape, bool)
    mask[10:20, 15:30] = mask[:3, :9] = False
    ways: list[Any] = [{"mask": mask}, {"mode": "constant"}, {"mask": mask, "mode": "reflect"}]
    for options in ways:
        assert not cvkern.canny(ramp, 1.5, 5, 10, operator=operator, **options).any()
    assert cvkern.canny(np.where(mask, ramp, 0), 1.5, 5, 10, operator=operator).any()
    hidden = np.where(mask, ramp, np.nan)  # masked pixels are not looked at
    assert not cvkern.canny(hidden, 1.5, 5, 10, mask, operator=operator).any()


# --- misuse --------------------------------------------------------------------------------------


def test_opencvs_order_of_arguments_is_refused():
    gray = skimage.data.coins()
    message = (
        "high_threshold must be given beside low_threshold at a sigma above 16, got sigma 100 and "
        "low_threshold 200: sigma comes before the thresholds here, while cv2.Canny has no sigma"
    )
    calls: list[Any] = [cvkern.canny, cvkern.subpixel_edges, cvkern.detect_lines]
    for function in calls:
        with pytest.raises(ValueError, match=f"^{message}$"):
            function(gray, 100, 200)


def test_thresholds_above_all_gradients_are_said_to_be(backend):
    gray = skimage.data.coins()[:90, :120] // 16
    ways: list[Any] = [{}, {"suppression": "sectors", "sigma": 0}, {"operator": "gaussian"}]
    for options in ways:
        with pytest.warns(UserWarning, match=r"^no edge was found: the longest gradient") as seen:
            assert not cvkern.canny(gray, low_threshold=90, high_threshold=100, **options).any()
        assert seen[0].filename == __file__
    with pytest.warns(UserWarning, match="below high_threshold 100"):
        cvkern.detect_segments(gray, 1.0, 90, 100)
    cvkern.canny(np.zeros((9, 9)), 1.0, 90, 100)  # nothing there to be found
