"""Chessboards: rendered ones whose corners are known, the primitives against NumPy and SciPy."""

import numpy as np
import pytest
import scipy.ndimage as ndi
from scipy.optimize import least_squares
from scipy.special import erf

import cvkern
from cvkern.geometry.cameras.chessboards import edge_table
from tests.geometry.boards import View, render
from tests.refusals import refused

F32, F64, U8 = np.float32, np.float64, np.uint8
SHAPE = 4, 5
SMALL = View(size=(150, 190))


def as_bytes(picture):
    return picture.round().clip(0, 255).astype(U8)


def bound(clean, truth, shape, noise, share=0.7):
    """Return the Cramer-Rao bound of corners, from the pixels that the fit looks at, (N,) pixels.

    A corner that moves by d changes the picture by the gradient times d; the brightness, the blur
    and the directions of the edges change it by what is even about the corner, and so cost nothing.
    """
    gy, gx = np.gradient(clean)
    grid = truth.reshape(*shape, 2)
    along, down = (np.gradient(grid, axis=axis).reshape(-1, 2) for axis in (1, 0))
    pixels = np.moveaxis(np.indices(clean.shape), 0, -1)
    bounds = []
    for corner, a, b in zip(truth, along, down, strict=True):
        place = (pixels - corner) @ np.linalg.inv(np.stack((a, b), axis=1)).T
        near = np.abs(place).max(axis=2) <= share
        slopes = np.stack((gy[near], gx[near]))
        bounds.append(np.sqrt(np.trace(np.linalg.inv(slopes @ slopes.T))) * noise)
    return np.array(bounds)


@pytest.mark.parametrize("tilt", [0, 40, 70])
def test_corners_are_found_within_the_bound_of_noise(backend, tilt):
    shape, noise = (5, 6), 0.02 * 180
    errors, bounds = [], []
    for number in range(3):
        turns = np.random.default_rng(number).uniform(0, 2 * np.pi, 2)
        view = View(np.radians(tilt), *turns, size=(210, 230))
        clean, _ = render(shape, view, noise=0, seed=number)
        picture, truth = render(shape, view, seed=number)
        found = cvkern.detect_chessboard(as_bytes(picture), shape)
        assert found is not None
        errors.append(np.linalg.norm(found - truth, axis=1))
        bounds.append(bound(clean, truth, shape, noise))
    assert np.max(errors) < 0.15
    # 90 corners: the standard deviation of this ratio is 0.05.
    assert np.sqrt(np.mean(np.square(errors)) / np.mean(np.square(bounds))) < 1.3


def test_pictures_of_all_kinds(backend):
    picture, truth = render(SHAPE, SMALL)
    gray = as_bytes(picture)
    found = cvkern.detect_chessboard(gray, SHAPE)
    np.testing.assert_allclose(found, truth, rtol=0, atol=0.1)
    for same in (np.repeat(gray[..., None], 3, 2), gray.astype(np.uint16), gray.astype(F64)):
        np.testing.assert_allclose(cvkern.detect_chessboard(same, SHAPE), found, atol=1e-3)
    green = np.zeros((*gray.shape, 4), U8)
    green[..., 1] = gray
    green[..., 3] = np.arange(gray.shape[1])  # alpha is not looked at
    np.testing.assert_allclose(cvkern.detect_chessboard(green, SHAPE), truth, rtol=0, atol=0.1)


def test_large_pictures_begin_with_smaller_ones():
    """Squares of 160 pixels in a picture of 1520, which is looked at in half its size first."""
    picture, truth = render(SHAPE, SMALL._replace(roll=0.3), noise=0)
    large = as_bytes(ndi.zoom(picture, 8, order=1, grid_mode=True, mode="nearest"))
    found = cvkern.detect_chessboard(large, SHAPE)
    np.testing.assert_allclose(found, 8 * truth + 3.5, rtol=0, atol=0.3)


def test_which_end_is_the_first_of_a_board_of_two_colours():
    """Rows and columns of which one is odd: the colours tell how the board is turned."""
    picture, truth = render(SHAPE, SMALL)
    last = np.array(picture.shape) - 1
    for turns, moved in (
        (0, truth),
        (1, np.stack((last[1] - truth[:, 1], truth[:, 0]), 1)),
        (2, last - truth),
        (3, np.stack((truth[:, 1], last[0] - truth[:, 0]), 1)),
    ):
        found = cvkern.detect_chessboard(as_bytes(np.rot90(picture, turns)), SHAPE)
        np.testing.assert_allclose(found, moved, rtol=0, atol=0.1)
    swapped = cvkern.detect_chessboard(as_bytes(picture), (SHAPE[1], SHAPE[0]))
    assert {tuple(p.round()) for p in swapped} == {tuple(p.round()) for p in truth}
    way = swapped[SHAPE[0] - 1] - swapped[0]
    assert abs(way[0]) > 10 * abs(way[1])  # its rows are the columns of the other


@pytest.mark.parametrize("shape", [(3, 5), (4, 4), (3, 3), (2, 2)])
def test_which_end_is_the_first_of_boards_that_look_alike_when_turned(shape):
    picture, truth = render(shape, SMALL._replace(roll=0.3))
    for turns in (0, 2):
        seen = as_bytes(np.rot90(picture, turns))
        where = truth if turns == 0 else np.array(picture.shape) - 1 - truth
        found = cvkern.detect_chessboard(seen, shape)
        assert {tuple(p.round()) for p in found} == {tuple(p.round()) for p in where}
        assert found[shape[1] - 1, 1] > found[0, 1]  # rows run to the right,
        assert found[-1, 0] > found[0, 0]  # and columns down
    inverse = cvkern.detect_chessboard(as_bytes(260 - picture), shape)
    assert inverse is not None


def test_a_smudged_corner_is_found_again():
    picture, truth = render(SHAPE, SMALL, noise=0.01)
    y, x = truth[7].round().astype(int)
    spot = np.hypot(*(np.indices(picture.shape) - np.array([y, x])[:, None, None]))
    picture += 140 * np.exp(-(spot**2) / 30)  # a highlight, saturated in the middle
    found = cvkern.detect_chessboard(as_bytes(picture), SHAPE)
    assert found is not None
    off = np.linalg.norm(found - truth, axis=1)
    assert np.delete(off, 7).max() < 0.1
    assert off[7] < 2


def test_what_is_no_such_board():
    picture, truth = render(SHAPE, SMALL)
    board = as_bytes(picture)
    for other in ((4, 4), (5, 5), (3, 5), (4, 7)):
        assert cvkern.detect_chessboard(board, other) is None
    # Without its last corner, the last column still belongs to the board.
    y, x = truth[-1].round().astype(int)
    spoilt = board.copy()
    spoilt[y - 9 : y + 10, x - 9 : x + 10] = 128
    assert cvkern.detect_chessboard(spoilt, (4, 4)) is None
    covered = board.copy()
    covered[:, 110:] = 128
    assert cvkern.detect_chessboard(covered, SHAPE) is None
    rng = np.random.default_rng(0)
    assert cvkern.detect_chessboard(rng.integers(0, 255, (90, 90), U8), (3, 4)) is None
    assert cvkern.detect_chessboard(np.zeros((90, 90), U8), (3, 4)) is None
    assert cvkern.detect_chessboard(np.zeros((5, 400), U8), (3, 4)) is None


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_no_numbers(value):
    picture, truth = render(SHAPE, SMALL)
    picture = (picture / 255).astype(F32)  # photographs from 0 to 1 do as well
    picture[:5] = value
    found = cvkern.detect_chessboard(picture, SHAPE)
    np.testing.assert_allclose(found, truth, rtol=0, atol=0.1)
    assert cvkern.detect_chessboard(np.full((50, 60), value), SHAPE) is None


def test_of_two_boards_it_is_the_larger():
    small, _ = render(SHAPE, View(size=(110, 130)), square=12)
    large, truth = render(SHAPE, SMALL)
    both = as_bytes(np.hstack((np.pad(small, ((0, 40), (0, 0)), mode="edge"), large)))
    found = cvkern.detect_chessboard(both, SHAPE)
    np.testing.assert_allclose(found, truth + np.array([0, 130]), rtol=0, atol=0.1)


def test_noise_does_not_hide_the_larger_of_two_boards():
    """In the full picture, chance saddles cut the grid of the large board, not of the small one."""
    picture = np.full((480, 640), 120.0)
    for side, top, left in ((42, 60, 130), (8, 370, 5)):
        board = np.kron(np.indices((7, 10)).sum(axis=0) % 2, np.ones((side, side))) * 180 + 30
        board = np.pad(board, side // 2, constant_values=210)
        picture[top : top + board.shape[0], left : left + board.shape[1]] = board
    noise = np.random.default_rng(0).normal(0, 25, picture.shape)
    found = cvkern.detect_chessboard(as_bytes(cvkern.gaussian(picture, 0.8) + noise), (6, 9))
    assert found is not None
    first = np.sort(found.round().astype(int), axis=0)[0]
    assert abs(first - (60 + 21 + 42, 130 + 21 + 42)).max() <= 1


# --- primitives ----------------------------------------------------------------------------------


@pytest.mark.parametrize("scalar", [U8, F32])
def test_smaller_pictures(kernels, scalar):
    rng = np.random.default_rng(0)
    src = rng.integers(0, 256, (11, 14, 3)).astype(scalar)
    found = kernels("geometry.cameras.chessboards.shrink", src, out=[((3, 4), F32)])
    weights = np.array([0.2125, 0.7154, 0.0721], F32)
    parts = src.astype(F32) * weights
    gray = parts[..., 0] + parts[..., 1] + parts[..., 2]
    want = np.zeros((3, 4), F32)
    for i, j in np.ndindex(3, 3):  # in the order of the pixels
        want += gray[i:9:3, j:12:3]
    np.testing.assert_array_equal(found, want / F32(9))


def test_saddles(kernels):
    src = ndi.gaussian_filter(np.random.default_rng(0).normal(size=(20, 31)), 1).astype(F32)
    found = kernels("geometry.cameras.chessboards.saddles", src, out=[(src.shape, F32)])
    c, h = src[1:-1, 1:-1], F32(0.0625)
    xx = (src[1:-1, :-2] + src[1:-1, 2:]) - 2 * c
    yy = (src[:-2, 1:-1] + src[2:, 1:-1]) - 2 * c
    xy = (src[:-2, :-2] + src[2:, 2:]) - (src[:-2, 2:] + src[2:, :-2])
    want = np.maximum(h * (xy * xy) - xx * yy, 0)
    np.testing.assert_array_equal(found, np.pad(want, 1))


@pytest.mark.parametrize("blur", [0, 2])
def test_the_fit_of_a_corner_is_the_least_there_is(kernels, blur):
    """SciPy fits all nine numbers at once, with the error function itself."""
    picture, truth = render(SHAPE, SMALL._replace(tilt=0.6, about=0.7, roll=0.2))
    picture = ndi.gaussian_filter(picture.astype(F32), blur)
    grid = truth.reshape(*SHAPE, 2)
    a, b = grid[1, 2] - grid[1, 1], grid[2, 1] - grid[1, 1]
    start = np.array([*grid[1, 1] + (0.3, -0.4), *a, *b, 1.0], F32)
    found = kernels(
        "geometry.cameras.chessboards.refine", picture[..., None], edge_table(), start[None],
        out=[((1, 5), F64)],
    )[0]  # fmt: skip

    pixels = np.moveaxis(np.indices(picture.shape), 0, -1) - start[:2].astype(F64)
    near = np.abs(pixels @ np.linalg.inv(np.stack((a, b), axis=1)).T).max(axis=2) <= 0.7
    places, values = pixels[near], picture[near]

    def residuals(free):
        y, x, one, two, blur, height, middle, gy, gx = free
        parts = [
            erf(((places[:, 0] - y) * np.cos(t) - (places[:, 1] - x) * np.sin(t)) / blur / 2**0.5)
            for t in (one, two)
        ]
        return middle + height * parts[0] * parts[1] + places @ (gy, gx) - values

    turns = [np.arctan2(*edge) for edge in (a, b)]
    begin = [0, 0, *turns, 1, np.copysign(90, found[2]), 130, 0, 0]
    best = least_squares(residuals, begin, x_scale="jac").x
    # The last step was shorter than 0.002, and what would follow is far shorter; tables have 7e-6.
    np.testing.assert_allclose(found[:2], start[:2] + best[:2], rtol=0, atol=5e-4)
    np.testing.assert_allclose(abs(found[2]), abs(2 * best[5]), rtol=1e-4)
    np.testing.assert_allclose(found[4], best[4], rtol=5e-4)  # one pixel, as uncertain as a place
    left = np.sqrt(np.sum(residuals(best) ** 2) / (near.sum() - 9))
    # The residual is that before the last step, and grows with the square of what it moved.
    np.testing.assert_allclose(found[3], left, rtol=1e-3)


# --- errors --------------------------------------------------------------------------------------


def test_a_fit_goes_on_while_one_coordinate_moves(backend):
    """Rows are right from the first step on; columns are a quarter of a pixel beside pixels."""
    fine, side = 8, 16
    y, x = (np.indices((7 * side * fine, 8 * side * fine)) + 0.5) / fine - 0.5
    row, column = np.floor((y - side) / side), np.floor((x - side - 0.25) / side)
    board = (row >= 0) & (row < 5) & (column >= 0) & (column < 6)
    picture = ndi.gaussian_filter(20 + 200 * np.where(board, (row + column) % 2, 1), 0.8 * fine)
    picture = picture.reshape(7 * side, fine, 8 * side, fine).mean(axis=(1, 3))
    found = np.asarray(cvkern.detect_chessboard(picture, (4, 5)))
    # The blurred edge is the model of the fit, but for its truncation: right to 1e-4.
    off = found - found.round()
    np.testing.assert_allclose(off - [0, 0.25], 0, atol=5e-4)


def test_errors(no_kernel_runs):
    picture = np.zeros((40, 50))
    for image, shape, said in (
        (picture, (1, 4), "shape must be in [2, 1000], got 1"),
        (picture, 4, "shape must be rows and columns of corners, got 4"),
        (picture, (3, 4, 5), "shape must be rows and columns of corners, got (3, 4, 5)"),
        (np.zeros((4, 5, 2)), (3, 4),
         "image must have shape (H, W) or (H, W, 3 or 4), got (4, 5, 2)"),
    ):  # fmt: skip
        refused(ValueError, said, cvkern.detect_chessboard, image, shape)
    refused(
        TypeError, "shape must be an integer, got 2.5", cvkern.detect_chessboard, picture, (3, 2.5)
    )


def test_a_stack_gives_a_list(backend):
    """One result for each photograph; None where there is no board."""
    board = np.kron(np.indices((5, 6)).sum(axis=0) % 2, np.ones((20, 20))) * 200
    stack = np.stack([np.pad(board, 25, constant_values=220), np.full((150, 170), 90.0)])
    got = cvkern.detect_chessboard(stack, SHAPE, batch_axis=0)
    assert got[1] is None
    np.testing.assert_array_equal(got[0], cvkern.detect_chessboard(stack[0], SHAPE))
    assert got[0].shape == (20, 2)
