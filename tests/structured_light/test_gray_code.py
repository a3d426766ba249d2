"""Gray codes: patterns, their decoding, and what a real capture gives."""

import cv2
import imageio.v3 as iio
import numpy as np
import pytest
import scipy.ndimage

import cvkern
from tests.structured_light import reference_structured_light as reference
from tests.truth import truth

I32, U8 = np.int32, np.uint8
SHAPES = [(1, 1), (3, 5), (40, 64), (65, 33), (100, 129)]


@pytest.mark.parametrize(("count", "bits"), [(1, 1), (2, 1), (5, 3), (64, 6), (65, 7)])
def test_neighbouring_lines_differ_in_one_bit(count, bits):
    frames = cvkern.gray_code_patterns((3, count), axes=["columns"], lights=True)
    assert frames.shape == (2 * bits + 2, 3, count)
    np.testing.assert_array_equal(frames[0:-2:2], 255 - frames[1:-2:2])
    assert (frames[-2] == 255).all()
    assert (frames[-1] == 0).all()
    codes = frames[0:-2:2, 0] == 255
    assert (np.diff(codes, axis=1).sum(axis=0) == 1).all()
    assert len(set(map(bytes, codes.T))) == count
    assert not codes[:, 0].any()  # the code of line 0 is 0


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("axes", [["columns"], ["rows"], ["columns", "rows"], ["rows", "columns"]])
def test_the_projector_reads_its_own_patterns(backend, shape, axes):
    seen = cvkern.gray_code_patterns(shape, axes=axes)
    assert seen.flags.c_contiguous
    found = cvkern.decode_gray_code(seen, shape, axes=axes, margin=100)
    rows, columns = np.indices(shape)
    for name, want in (("columns", columns), ("rows", rows)):
        got = getattr(found, name)
        if name in axes:
            assert got.dtype == I32
            np.testing.assert_array_equal(got, want)
        else:
            assert got is None
    assert found.valid.all()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("shape", [(1, 1), (7, 300), (33, 65)])
def test_decode(kernels, shape, dtype):
    rng = np.random.default_rng(3)
    frames = rng.integers(0, 256, (12, *shape)).astype(dtype)
    if dtype == np.float32:
        frames += rng.random(frames.shape, np.float32)
        frames[5, 0, 0] = np.nan
    before = rng.integers(0, 2, shape).astype(U8)
    for begin, bits, size, margin in ((0, 6, 64, 3.0), (2, 5, 21, 0.0), (4, 1, 2, 30.5)):
        got = kernels(
            "structured_light.gray_code.decode", frames, begin, bits, size, margin, begin > 0,
            out=[(shape, I32), before],
        )  # fmt: skip
        want = reference.gray_codes(frames[begin : begin + 2 * bits], size, margin)
        np.testing.assert_array_equal(got[0], want)
        np.testing.assert_array_equal(got[1], (want >= 0) & ((begin == 0) | (before != 0)))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_accept(kernels, dtype):
    rng = np.random.default_rng(4)
    valid = rng.integers(0, 2, (9, 41)).astype(U8)
    white, black = rng.integers(0, 256, (2, 9, 41)).astype(dtype)
    white[0], black[0] = 120, 100  # just the contrast: too little
    name = "structured_light.gray_code.accept"
    got = kernels(name, white, black, 20.0, out=[valid])
    np.testing.assert_array_equal(got, (valid != 0) & (white.astype(float) - black > 20))


def photographs(shape, sigma, seed=0):
    """Photograph a slanted projector's picture with blur, shadow, texture and noise."""
    rng = np.random.default_rng(seed)
    y, x = np.indices((90, 120))
    column = np.floor(2 + (shape[1] - 4) * (x / 120 * 0.9 + y / 90 * 0.1)).astype(int)
    row = np.floor(1 + (shape[0] - 2) * y / 90).astype(int)
    paint = 0.5 + 0.5 * scipy.ndimage.gaussian_filter(rng.random((90, 120)), 2)
    paint[20:40, 30:50] = 0  # a shadow
    lit = cvkern.gray_code_patterns(shape, lights=True)[:, row, column]
    seen = 20 + paint * lit * 0.6 + rng.normal(0, sigma, lit.shape)
    return seen.clip(0, 255).round().astype(np.uint8), column, row, paint > 0


def test_the_margin_is_found_in_the_noise(backend):
    shape = (50, 96)
    for sigma in (0.5, 2.0, 6.0):
        seen, column, row, lit = photographs(shape, sigma)
        found = cvkern.decode_gray_code(seen[:-2], shape, seen[-2], seen[-1])
        valid = found.valid
        assert valid[lit].mean() > 0.97
        assert valid[~lit].mean() < 0.02
        wrong = (found.columns != column) | (found.rows != row)
        assert wrong[valid & lit].mean() == 0


def test_margins_and_contrasts(backend):
    seen, *_ = photographs((50, 96), 1.0)
    images, white, black = seen[:-2], seen[-2], seen[-1]
    pairs = np.abs(images[::2].astype(int) - images[1::2]).min(axis=0)
    given = cvkern.decode_gray_code(images, (50, 96), white, black, margin=40, contrast=60)
    lit = white.astype(int) - black > 60
    np.testing.assert_array_equal(given.valid, (pairs > 40) & lit & (given.columns >= 0))
    alone = cvkern.decode_gray_code(images, (50, 96), margin=40)
    np.testing.assert_array_equal(alone.columns, given.columns)
    np.testing.assert_array_equal(alone.valid, (alone.columns >= 0) & (alone.rows >= 0))
    listed = cvkern.decode_gray_code(list(images), (50, 96), margin=40)
    np.testing.assert_array_equal(listed.columns, given.columns)


@pytest.mark.parametrize(("light", "valid"), [(19, False), (21, True)])
def test_the_default_contrast_is_two_margins(backend, light, valid):
    seen = cvkern.gray_code_patterns((4, 6), axes=["columns"])
    white, black = np.full((4, 6), 50 + light, np.uint8), np.full((4, 6), 50, np.uint8)
    found = cvkern.decode_gray_code(seen, (4, 6), white, black, axes=["columns"], margin=10)
    assert (found.valid == valid).all()
    # Fractions of white count, although the patterns are bytes.
    white = white + np.float32(0.5) - light
    found = cvkern.decode_gray_code(seen, (4, 6), white, black, axes=["columns"], contrast=0.25)
    assert found.valid.all()


def test_codes_beyond_the_projector_are_none(backend):
    wide = cvkern.gray_code_patterns((1, 8), axes=["columns"])
    found = cvkern.decode_gray_code(wide, (1, 6), axes=["columns"], margin=1)
    np.testing.assert_array_equal(found.columns[0], [0, 1, 2, 3, 4, 5, -1, -1])


def test_capture_of_a_board(backend):
    """A real board: no pixel of it is off its plane by more than 1.5 columns or rows."""
    folder = truth("structured_light") / "gray_code_capture_0"
    images = np.stack([iio.imread(folder / f"graycode_{i:02d}.png") for i in range(42)])
    found = cvkern.decode_gray_code(images[:40], (768, 1024), images[40], images[41])
    assert found.valid.mean() > 0.62
    y, x = np.nonzero(found.valid)
    board = (x >= 160) & (x <= 695) & (y >= 254) & (y <= 695)
    y, x = y[board], x[board]
    camera = np.stack([x, y], axis=1).astype(np.float64)
    projector = np.stack([found.columns[y, x], found.rows[y, x]], axis=1).astype(np.float64)
    matrix, _ = cv2.findHomography(camera, projector)
    mapped = cv2.perspectiveTransform(camera[None], matrix)[0]
    off = np.linalg.norm(mapped - projector, axis=1)
    assert np.median(off) < 0.38
    assert (off < 1.5).all()


IMAGES = np.zeros((10, 4, 4))


@pytest.mark.parametrize(
    ("message", "arguments", "options"),
    [
        ("images must be 10 for columns and rows of shape (4, 8), got 9", (IMAGES[:9], (4, 8)), {}),
        ("images must be 3-D, got shape (4, 4)", (IMAGES[0], (4, 8)), {}),
        ("images must have one shape, got (2, 2), (3, 3)", ([np.eye(2), np.eye(3)], (4, 8)), {}),
        ("shape must be in [1, 65536], got 0", (IMAGES, (0, 8)), {}),
        (
            "white and black must be given together, got one of them",
            (IMAGES, (4, 8), IMAGES[0]),
            {},
        ),
        (
            "white must have the shape of an image, (4, 4), got (3, 3)",
            (IMAGES, (4, 8), np.eye(3), np.eye(3)),
            {},
        ),
        ("margin must be >= 0 and finite, got -1", (IMAGES, (4, 8)), {"margin": -1}),
        (
            "contrast must be >= 0 and finite, got nan",
            (IMAGES, (4, 8)),
            {"margin": 1, "contrast": np.nan},
        ),
        ("axes must name one axis or both, each once, got ()", (IMAGES, (4, 8)), {"axes": []}),
        ("axes must be one of ('columns', 'rows'), got 'x'", (IMAGES, (4, 8)), {"axes": ["x"]}),
    ],
)
def test_errors(no_kernel_runs, message, arguments, options):
    with pytest.raises(ValueError) as info:  # noqa: PT011  (the whole message is compared)
        cvkern.decode_gray_code(*arguments, **options)
    assert str(info.value) == message
