"""Every error of the public API names the argument, the rule and the value, and changes nothing."""

from typing import Any

import numpy as np
import pytest
import warp

import cvkern
from cvkern._checks import MAX_ELEMENTS
from cvkern._runtime import DEVICES
from cvkern.scale import TILED
from tests.refusals import DEEP, EVERY, FILTERS, FLAT, HUGE, PHOTOGRAPHS, refused

pytestmark = pytest.mark.usefixtures("no_kernel_runs")

BORDERS = "('reflect', 'constant', 'nearest', 'mirror', 'wrap')"


# --- images --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EVERY)
def test_images(name):
    function = EVERY[name]
    for image, shape in ((5, "()"), ([1, 2], "(2,)"), (np.zeros((1, 1, 1, 1)), "(1, 1, 1, 1)")):
        refused(ValueError, f"image must be 2-D or 3-D, got shape {shape}", function, image)
    for shape in ((0, 5), (5, 0), (0, 0)):
        refused(
            ValueError, f"image must not be empty, got shape {shape}", function, np.zeros(shape)
        )
    for image in (
        FLAT.astype(complex),
        FLAT.astype("M8[s]"),
        FLAT.astype(object),
        FLAT.astype(str),
    ):
        message = f"image must hold real numbers, got dtype {image.dtype}"
        refused(TypeError, message, function, image)
    refused(TypeError, "image must hold real numbers, got dtype object", function, None)
    huge, options = HUGE, {}
    if name in TILED:  # a single image is computed in strips
        huge, options = HUGE[None], {"batch_axis": 0}
    message = f"image must have at most {MAX_ELEMENTS} elements, got shape {huge.shape}"
    refused(ValueError, message, function, huge, **options)


@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_images_with_channels(name):
    for shape in ((4, 5, 1), (4, 5, 2), (4, 5, 5)):
        message = f"image must have shape (H, W) or (H, W, 3 or 4), got {shape}"
        refused(ValueError, message, EVERY[name], np.zeros(shape))


@pytest.mark.parametrize("name", [*FILTERS, "sobel", "scharr", "prewitt", "gradient"])
def test_batch_axis(name):
    function = EVERY[name]
    refused(ValueError, "batch_axis must be in [0, 0], got 1", function, DEEP, batch_axis=1)
    message = "image must be 3-D or 4-D, got shape (4, 5)"
    refused(ValueError, message, function, FLAT, batch_axis=0)
    if name in FILTERS:
        rule = "image must have 3 axes with batch_axis, and 4 with channel_axis too, got shape"
        message = f"{rule} (4, 5, 3) and channel_axis -1"
        refused(ValueError, message, function, DEEP, batch_axis=0, channel_axis=-1)
        message = f"{rule} (4, 5, 3, 1) and channel_axis None"
        refused(ValueError, message, function, DEEP[..., None], batch_axis=0)
        for axis, message in (
            (0, "channel_axis must differ from batch_axis, got 0"),
            (4, "channel_axis must be in [-3, 3], got 4"),
        ):
            stack = DEEP[..., None]
            refused(ValueError, message, function, stack, batch_axis=0, channel_axis=axis)
    else:
        message = "image must have shape (N, H, W) or (N, H, W, 3 or 4), got (4, 5, 3, 1)"
        refused(ValueError, message, function, DEEP[..., None], batch_axis=0)


@pytest.mark.parametrize("name", FILTERS)
def test_channel_axis(name):
    function = FILTERS[name]
    rule = "channel_axis must be given for 3-D images and for no others"
    refused(ValueError, f"{rule}, got None for shape (4, 5, 3)", function, DEEP)
    refused(ValueError, f"{rule}, got 0 for shape (4, 5)", function, FLAT, channel_axis=0)
    for axis in (3, -4):
        message = f"channel_axis must be in [-3, 2], got {axis}"
        refused(ValueError, message, function, DEEP, channel_axis=axis)


# --- options that many share ---------------------------------------------------------------------


@pytest.mark.parametrize("name", EVERY)
def test_mode_and_cval(name):
    function = EVERY[name]
    for mode in ("edge", "Reflect", "", 3, None):
        refused(
            ValueError, f"mode must be one of {BORDERS}, got {mode!r}", function, FLAT, mode=mode
        )
    for cval in (np.nan, np.inf, -np.inf):
        refused(ValueError, f"cval must be finite, got {cval}", function, FLAT, cval=cval)


@pytest.mark.parametrize("name", FILTERS)
def test_out(name):
    function = FILTERS[name]
    dtype = np.float64 if name == "median" else np.float32
    for wrong in (np.int16, np.float16, np.float32 if name == "median" else np.float64):
        out = np.full(FLAT.shape, 7, wrong)
        message = f"out must be {np.dtype(dtype)}, got {np.dtype(wrong)}"
        refused(TypeError, message, function, FLAT, out=out)
        assert (out == 7).all()
    for shape in ((5, 4), (4, 5, 1), (20,)):
        message = f"out must have shape (4, 5), got {shape}"
        refused(ValueError, message, function, FLAT, out=np.zeros(shape, dtype))
    refused(
        TypeError, "out must be an array like the image, got list", function, FLAT, out=[[0.0] * 5]
    )
    torch = pytest.importorskip("torch")
    out = torch.zeros((4, 5))
    refused(TypeError, "out must be an array like the image, got Tensor", function, FLAT, out=out)


@pytest.mark.parametrize("name", FILTERS)
def test_out_in_memory(name):
    function = FILTERS[name]
    image = np.zeros((4, 5), np.float32)
    frozen = np.zeros_like(image)
    frozen.flags.writeable = False
    for out in (np.zeros((5, 4), np.float32).T, np.zeros((4, 10), np.float32)[:, ::2], frozen):
        message = "out must be contiguous and writeable, got an array that is not"
        refused(ValueError, message, function, image, out=out)
    whole = np.arange(50, dtype=np.float32)
    shared = whole[10:30].reshape(4, 5)
    for out in (shared, whole[20:40].reshape(4, 5)):
        message = "out must not share memory with the image, got one that does"
        refused(ValueError, message, function, shared, out=out)
    np.testing.assert_array_equal(whole, np.arange(50))


def test_out_of_another_library():
    wp = pytest.importorskip("warp")
    image = wp.zeros((4, 5), dtype=wp.float32, device="cpu")
    scattered = wp.zeros((4, 10), dtype=wp.float32, device="cpu")[:, ::2]
    for function in FILTERS.values():
        message = "out must be contiguous and writeable, got an array that is not"
        refused(ValueError, message, function, image, out=scattered)
        message = "out must not share memory with the image, got one that does"
        refused(ValueError, message, function, image, out=image)


@pytest.mark.parametrize("name", ["gaussian", "gradient", "canny", "subpixel_edges"])
def test_sigma(name):
    function = EVERY[name]
    for sigma in (-1, -0.5, np.nan, np.inf, -np.inf):
        message = f"sigma must be >= 0 and finite, got {sigma}"
        refused(ValueError, message, function, FLAT, sigma=sigma)
    if name != "gaussian":
        for sigma in (0, 1e-16):  # what smooths nothing has no derivative
            message = f"sigma must be > 0 with the operator 'gaussian', got {sigma}"
            options = {"operator": "gaussian"} if name == "canny" else {}
            refused(ValueError, message, function, FLAT, sigma=sigma, **options)
    message = "sigma must reach at most 1048576 pixels, got 4e+09"  # not fill the memory
    refused(ValueError, message, function, FLAT, sigma=1e9)


# --- one function at a time ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sigma": (1, -2)}, "sigma must be >= 0 and finite, got -2"),
        ({"sigma": (1, 2, 3)}, "sigma must be one number or two, got 3"),
        ({"sigma": ()}, "sigma must be one number or two, got 0"),
        ({"order": -1}, "order must be in [0, 32], got -1"),
        ({"order": (0, 33)}, "order must be in [0, 32], got 33"),
        ({"order": (0, 1, 2)}, "order must be one number or two, got 3"),
        ({"truncate": -1}, "truncate must be >= 0 and finite, got -1"),
        ({"truncate": np.nan}, "truncate must be >= 0 and finite, got nan"),
        ({"truncate": np.inf}, "truncate must be >= 0 and finite, got inf"),
    ],
)
def test_gaussian(options, message):
    refused(ValueError, message, cvkern.gaussian, FLAT, **options)


@pytest.mark.parametrize(
    ("taps", "message"),
    [
        ([1, 2], "taps must be 1-D and of odd length, got shape (2,)"),
        (([1], [1, 2, 3, 4]), "taps must be 1-D and of odd length, got shape (4,)"),
        (([1], []), "taps must be 1-D and of odd length, got shape (0,)"),
        ([[[1]], [[1]]], "taps must be 1-D and of odd length, got shape (1, 1)"),
        ([[1], [1], [1]], "taps must be one kernel or two, got 3"),
        (([1],), "taps must be one kernel or two, got 1"),
        ([np.nan], "taps must be finite, got [nan]"),
        (([1], [1, np.inf, 1]), "taps must be finite, got [ 1. inf  1.]"),
    ],
)
def test_correlate_separable(taps, message):
    refused(ValueError, message, cvkern.correlate_separable, FLAT, taps)


def test_radius():
    for radius in (-1, 2**20 + 1, (0, -1)):
        wrong = np.ravel(radius)[-1]
        message = f"radius must be in [0, 1048576], got {wrong}"
        refused(ValueError, message, cvkern.box, FLAT, radius)
    refused(ValueError, "radius must be one number or two, got 3", cvkern.box, FLAT, (1, 1, 1))
    for radius in (-1, 0, 16):
        message = f"radius must be in [1, 15], got {radius}"
        refused(ValueError, message, cvkern.median, FLAT, radius)


@pytest.mark.parametrize(
    ("dtype", "cval"),
    [
        ("uint8", -1),
        ("uint8", 256),
        ("uint8", 0.5),
        ("int8", -129),
        ("bool", 2),
        ("int64", 1e19),
        ("float16", 1e6),
    ],
)
def test_cval_of_median(dtype, cval):
    message = f"cval must be a value of {dtype}, got {float(cval)}"
    refused(ValueError, message, cvkern.median, FLAT.astype(dtype), cval=cval)


@pytest.mark.parametrize("name", ["sobel", "scharr", "prewitt"])
def test_axis(name):
    for axis in (2, -1, 0.5):
        message = f"axis must be 0, 1 or None, got {axis}"
        refused(ValueError, message, EVERY[name], FLAT, axis=axis)


def test_operator_and_norm():
    message = "operator must be one of ('gaussian', 'sobel', 'scharr'), got 'prewitt'"
    refused(ValueError, message, cvkern.gradient, FLAT, operator="prewitt")
    message = "operator must be one of ('sobel', 'scharr', 'gaussian'), got 'prewitt'"
    refused(ValueError, message, cvkern.canny, FLAT, operator="prewitt")
    message = "suppression must be one of ('interpolated', 'sectors'), got 'none'"
    refused(ValueError, message, cvkern.canny, FLAT, suppression="none")
    message = f"mask must have the shape of the image, {FLAT.shape}, got (2, 3)"
    refused(ValueError, message, cvkern.canny, FLAT, mask=np.ones((2, 3)))
    message = "norm must be one of ('l1', 'l2'), got 'L2'"
    refused(ValueError, message, cvkern.canny, FLAT, norm="L2")


@pytest.mark.parametrize("name", ["canny", "subpixel_edges"])
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"low_threshold": -1}, "low_threshold must be >= 0, got -1"),
        ({"low_threshold": np.nan}, "low_threshold must be >= 0, got nan"),
        ({"high_threshold": -0.5}, "high_threshold must be >= 0, got -0.5"),
        ({"high_threshold": np.nan}, "high_threshold must be >= 0, got nan"),
        (
            {"low_threshold": 5, "high_threshold": 2.5},
            "low_threshold must be <= high_threshold, got 5 > 2.5",
        ),
        (
            {"high_threshold": 1.5, "use_quantiles": True},
            "high_threshold must be a quantile in [0, 1], got 1.5",
        ),
        (
            {"low_threshold": 0.9, "high_threshold": 0.5, "use_quantiles": True},
            "low_threshold must be <= high_threshold, got 0.9 > 0.5",
        ),
    ],
)
def test_thresholds(name, options, message):
    refused(ValueError, message, EVERY[name], FLAT, **options)


# --- values of a wrong type, or beyond float32 ---------------------------------------------------


@pytest.mark.parametrize(
    ("name", "options", "error", "rule"),
    [
        ("gaussian", {"sigma": "a"}, TypeError, "a number, got 'a'"),
        ("gaussian", {"sigma": None}, TypeError, "a number, got None"),
        ("gradient", {"sigma": (1, 2)}, TypeError, "a number, got (1, 2)"),
        ("canny", {"sigma": np.ones(1)}, TypeError, "a number, got array([1.])"),
        ("gaussian", {"truncate": "wide"}, TypeError, "a number, got 'wide'"),
        ("gaussian", {"order": 1.5}, TypeError, "an integer, got 1.5"),
        ("gaussian", {"cval": None}, TypeError, "a number, got None"),
        ("gaussian", {"cval": 1e300}, ValueError, "finite, got 1e+300"),
        ("gaussian", {"sigma": 1e300}, ValueError, ">= 0 and finite, got 1e+300"),
        ("box", {"radius": 1.0}, TypeError, "an integer, got 1.0"),
        ("median", {"radius": (1, 1)}, TypeError, "an integer, got (1, 1)"),
        ("median", {"cval": "x"}, TypeError, "a number, got 'x'"),
        ("canny", {"low_threshold": "a"}, TypeError, "a number, got 'a'"),
        ("canny", {"high_threshold": [1]}, TypeError, "a number, got [1]"),
        ("gaussian", {"channel_axis": 1.5}, TypeError, "an integer, got 1.5"),
        ("gaussian", {"channel_axis": "last"}, TypeError, "an integer, got 'last'"),
        ("sobel", {"axis": "x"}, ValueError, "0, 1 or None, got 'x'"),
    ],
)
def test_wrong_types(name, options, error, rule):
    ((argument, _),) = options.items()
    image = DEEP if argument == "channel_axis" else FLAT
    refused(error, f"{argument} must be {rule}", EVERY[name], image, **options)


@pytest.mark.parametrize(
    ("taps", "error", "rule"),
    [
        (5, TypeError, "a sequence, got 5"),
        ([], ValueError, "1-D and of odd length, got shape (0,)"),
        (["a"], TypeError, "real numbers, got ['a']"),
        ([1j], TypeError, "real numbers, got [1j]"),
        ([1e300], ValueError, "finite, got [1.e+300]"),
    ],
)
def test_wrong_taps(taps, error, rule):
    refused(error, f"taps must be {rule}", cvkern.correlate_separable, FLAT, taps)


def test_rows_that_differ():
    with pytest.raises(ValueError, match=r"^image must be rectangular, got rows that differ: "):
        cvkern.gaussian([[1, 2], [3]])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"backend": "cuda"}, "backend must be one of ('warp', 'taichi'), got 'cuda'"),
        ({"backend": "Warp"}, "backend must be one of ('warp', 'taichi'), got 'Warp'"),
        ({"backend": ""}, "backend must be one of ('warp', 'taichi'), got ''"),
        ({"device": "gpu"}, f"device must be {DEVICES}, got 'gpu'"),
        ({"device": "cuda:"}, f"device must be {DEVICES}, got 'cuda:'"),
        ({"device": "cuda:-1"}, f"device must be {DEVICES}, got 'cuda:-1'"),
        ({"device": ""}, f"device must be {DEVICES}, got ''"),
    ],
)
def test_use(options, message):
    refused(ValueError, message, cvkern.use, **options)


def test_use_of_a_wrong_type():
    wrong: Any = 3
    refused(
        ValueError, "backend must be one of ('warp', 'taichi'), got 3", cvkern.use, backend=wrong
    )
    refused(ValueError, f"device must be {DEVICES}, got 3", cvkern.use, device=wrong)


def test_tensors_that_require_grad():
    torch = pytest.importorskip("torch")
    image = torch.zeros((4, 5), requires_grad=True)
    message = "tensors must not require grad, got one that does: call .detach()"
    for function in EVERY.values():
        refused(TypeError, message, function, image)


def test_warp_arrays_of_vectors():
    image = warp.zeros((4, 5), dtype=warp.vec3, device="cpu")
    with pytest.raises(TypeError, match=r"^Warp arrays must hold scalars, got vec3"):
        cvkern.gaussian(image)


def test_a_path_where_an_image_belongs():
    refused(TypeError, "image must hold real numbers, got dtype <U11", cvkern.canny, "picture.png")


@pytest.mark.parametrize("value", [[], None, "yes", 2, np.ones(2)])
def test_flags(value):
    message = f"use_quantiles must be True or False, got {value!r}"
    refused(TypeError, message, cvkern.canny, FLAT, use_quantiles=value)
    refused(TypeError, message, cvkern.subpixel_edges, FLAT, use_quantiles=value)
