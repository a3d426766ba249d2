"""Inputs as images: buffers, data frames, byte orders, and inputs that are refused by name."""

import numpy as np
import pytest

import cvkern
from cvkern import images
from cvkern._arrays import NUMPY, library
from tests.calls import CALLS, blobs, fields

SLICED = {name for name in CALLS if name.startswith("radiance.")}  # the tests' own calls slice
TAKEN = [name for name in CALLS if name not in SLICED]


class Unreadable:
    def __array__(self, *args, **options):
        raise RuntimeError("no values here")


@pytest.mark.parametrize("name", TAKEN)
def test_buffers_are_read(name):
    image = blobs(24, 40)
    for a, b in zip(
        fields(CALLS[name](memoryview(image.data))), fields(CALLS[name](image)), strict=True
    ):
        np.testing.assert_array_equal(a, b)


def test_data_frames_are_read():
    class Frame:
        """What a data frame offers: a shape, and its values as an array; no dtype."""

        shape = (24, 40)

        def __array__(self, dtype=None, copy=None):
            return blobs(24, 40)

    got, want = cvkern.gaussian(Frame(), 1.0), cvkern.gaussian(blobs(24, 40), 1.0)  # pyright: ignore[reportArgumentType]
    np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("given", ["ab", b"ab", {3: 4, 5: 6}, {3, 5}, bytearray(2)])
@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("shape", lambda v: cvkern.detect_chessboard(REAL, v)),
        ("images", lambda v: cvkern.stitch(v)),
        ("disparities", lambda v: cvkern.stereo_cost(REAL, REAL, v)),
    ],
)
def test_text_mappings_and_sets_are_no_sequences(name, call, given):
    with pytest.raises((TypeError, ValueError), match=rf"^{name} must be "):
        call(given)


@pytest.mark.parametrize("name", TAKEN)
@pytest.mark.parametrize(
    ("value", "message"),
    [
        (None, "must hold real numbers"),
        (object(), "must hold real numbers"),
        ({}, "must hold real numbers"),
        (10**400, "must hold real numbers"),
        (1j * np.ones((9, 9)), "must hold real numbers"),
        (Unreadable(), "must be an array that NumPy can read, got Unreadable: no values here"),
        (np.ma.masked_array(np.ones((9, 9))), r"must not be masked, got MaskedArray: pass"),
    ],
)
def test_what_is_no_image_is_refused_by_name(name, value, message):
    with pytest.raises(TypeError, match=rf"^\w+ {message}"):
        CALLS[name](value)


NUMBERS = {
    "sigma": lambda v: cvkern.gaussian(np.ones((9, 9)), v),
    "cval": lambda v: cvkern.gaussian(np.ones((9, 9)), cval=v),
    "truncate": lambda v: cvkern.gaussian(np.ones((9, 9)), truncate=v),
    "radius": lambda v: cvkern.median(np.ones((9, 9)), v),
    "focal": lambda v: cvkern.disparity_to_depth(np.ones((9, 9)), v, 1.0),
}


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize(
    "value",
    [10**400, -(10**5000), np.complex128(1 + 2j), 1j, "3", b"3", [1, [2, 3]], object()],
    ids=["large", "low", "complex", "imaginary", "text", "bytes", "ragged", "object"],
)
def test_numbers_are_refused_by_name(name, value):
    """Neither OverflowError nor NumPy's warning that an imaginary part is dropped."""
    with pytest.raises((TypeError, ValueError), match=rf"^{name}"):
        NUMBERS[name](value)


def test_huge_integers_are_not_written_out():
    with pytest.raises(ValueError, match=r"^sigma must be .*, got an integer of 1329 bits$"):
        cvkern.gaussian(np.ones((3, 3)), 10**400)


def test_values_beyond_float32_become_infinite_in_silence():
    image = np.full((3, 4), 1e300)
    assert np.isposinf(cvkern.gaussian(image, 0.0)).all()


def swapped(array):
    return array.astype(array.dtype.newbyteorder())


MATCH = {"disparities": (0, 4), "data_range": 1}
REAL = np.random.default_rng(0).random((20, 30), np.float32)
WORDS = np.random.default_rng(0).integers(0, 65535, (20, 30)).astype(np.uint16)


SWAPPED = {
    "draw_points": lambda a, f: images.draw_points(a, f[:3, :2] * 10),
    "draw_lines": lambda a, f: images.draw_lines(a, f[:3, :4] * 10),
    "draw_circles": lambda a, f: images.draw_circles(a, f[:3, :3] * 10),
    "overlay_mask": lambda a, f: images.overlay_mask(a, np.asarray(f) > 0.5),
    "luma": lambda a, f: images.luma(np.stack([a] * 3, -1)),
    "apply_colormap": lambda a, f: images.apply_colormap(f),
    "median": lambda a, f: cvkern.median(a, 1),
    "median of floats": lambda a, f: cvkern.median(f, 1),
    "stereo_cost": lambda a, f: cvkern.stereo_cost(a, a, (0, 4)),
    "aggregate_semi_global": lambda a, f: cvkern.aggregate_semi_global(
        np.repeat(a[..., None] // 256, 4, -1), 3, 9
    ),
    "winner_take_all": lambda a, f: cvkern.winner_take_all(np.repeat(f[..., None], 4, -1)),
    "StereoMatcher": lambda a, f: cvkern.StereoMatcher(f.shape, **MATCH)(f, f),
    "hough_line": lambda a, f: cvkern.hough_line(f > 0.5, weights=f).votes,
    "hough_circle_peaks": lambda a, f: cvkern.hough_circle_peaks(
        np.stack([f, f]), [3, 4], 1, 1
    ),
    "left_right_check": lambda a, f: cvkern.left_right_check(f, f),
}  # fmt: skip


@pytest.mark.parametrize("name", SWAPPED)
def test_either_byte_order(name, backend):
    got = fields(SWAPPED[name](swapped(WORDS), swapped(REAL)))
    for a, b in zip(got, fields(SWAPPED[name](WORDS, REAL)), strict=True):
        if b is not None:
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("image", [WORDS, REAL], ids=["uint16", "float32"])
def test_a_median_keeps_the_byte_order(image):
    assert cvkern.median(swapped(image), 1).dtype == swapped(image).dtype


def test_a_frame_of_another_byte_order():
    with cvkern.StereoMatcher(REAL.shape, **MATCH) as match:
        want = [a.copy() for a in fields(match(REAL, REAL)) if a is not None]
        got = [a for a in fields(match(swapped(REAL), REAL)) if a is not None]
    for a, b in zip(got, want, strict=True):
        np.testing.assert_array_equal(a, b)


def test_under_jit():
    jax = pytest.importorskip("jax")
    with pytest.raises(TypeError, match=r"^image must have values, got \w*Tracer: call cvkern"):
        jax.jit(cvkern.gaussian)(np.ones((3, 4), np.float32))


def test_subclasses_of_tensors_are_tensors():
    torch = pytest.importorskip("torch")

    class Mine(torch.Tensor):
        pass

    given = torch.ones(3, 4).as_subclass(Mine)  # pyright: ignore[reportArgumentType]
    assert library(given) is library(torch.ones(1))
    assert library(np.ones(3)) is library([1]) is NUMPY
