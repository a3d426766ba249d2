"""Segments of lines, fitted lines, and lines and segments of photographs."""

from typing import Any

import cv2
import numpy as np
import pytest
import skimage.data

import cvkern
from profiling.cases import CASES
from tests.truth import truth

HALF = np.pi / 2


def test_runs_of_a_row(backend):
    mask = np.zeros((40, 90), bool)
    for first, last in ((3, 20), (23, 40), (45, 52), (60, 75)):
        mask[10, first : last + 1] = True
    options: Any = {"min_length": 10, "max_gap": 3}
    found = cvkern.hough_line_segments(mask, [HALF], [10.0], **options)
    # The gap of 3 is bridged, that of 5 is not; 45 to 52 is too short.
    want = [[10, 75, 10, 60], [10, 40, 10, 3]]
    np.testing.assert_allclose(found, want, atol=1e-5)
    assert found.dtype == np.float32
    options["max_gap"] = 2.9
    assert len(cvkern.hough_line_segments(mask, [HALF], [10.0], **options)) == 3


@pytest.mark.parametrize("angle", [-1.5, -0.8, 0.0, 0.4, 1.0])
def test_ends_lie_on_the_line(backend, angle):
    y, x = np.mgrid[:120, :160]
    rho = 80 * np.cos(angle) + 60 * np.sin(angle)
    along = (y - 60) * np.cos(angle) - (x - 80) * np.sin(angle)
    mask = (np.abs(x * np.cos(angle) + y * np.sin(angle) - rho) < 0.5) & (np.abs(along) < 40)
    (found,) = cvkern.hough_line_segments(mask, [angle], [rho])
    rows, columns = found[::2].astype(float), found[1::2].astype(float)
    # Coordinates below 128 are rounded to float32: by 2^-18 at most.
    np.testing.assert_allclose(columns * np.cos(angle) + rows * np.sin(angle), rho, atol=1e-5)
    assert np.hypot(*np.diff([rows, columns])[:, 0]) == pytest.approx(79, abs=1.5)


def test_a_pixel_is_of_the_first_line_it_is_on(backend):
    """Two lines cross: the pixels of the crossing are missing from the second."""
    mask = np.zeros((61, 61), bool)
    mask[30, :] = mask[:, 30] = True
    theta, rho = [HALF, 0.0], [30.0, 30.0]
    for order in ([0, 1], [1, 0]):
        found = cvkern.hough_line_segments(
            mask, np.take(theta, order), np.take(rho, order), max_gap=2
        )
        assert len(found) == 3
        lengths = np.hypot(found[:, 2] - found[:, 0], found[:, 3] - found[:, 1])
        np.testing.assert_allclose(lengths, [60, 28, 28], atol=1e-4)


def test_pixels_whose_gradient_is_along_the_line_are_left_out(backend):
    mask = np.zeros((21, 61), bool)
    mask[10] = True
    orientation = np.full(mask.shape, -HALF, np.float32)  # across, either way
    orientation[:, 30:] += np.float32(0.3)
    options: Any = {"orientation": orientation, "orientation_tolerance": 0.2}
    (found,) = cvkern.hough_line_segments(mask, [HALF], [10.0], **options)
    np.testing.assert_allclose(found, [10, 29, 10, 0], atol=1e-5)
    options["orientation_tolerance"] = 0.31
    assert cvkern.hough_line_segments(mask, [HALF], [10.0], **options)[0, 1] == 60


def test_no_lines_and_no_pixels(backend):
    mask = np.ones((20, 30), bool)
    for found in (
        cvkern.hough_line_segments(mask, [], []),
        cvkern.hough_line_segments(~mask, [0.0], [3.0]),
        cvkern.hough_line_segments(mask, [0.0], [300.0]),
        cvkern.detect_segments(mask),
    ):
        assert found.shape == (0, 4)
        assert found.dtype == np.float32
    assert [len(a) for a in cvkern.detect_lines(mask)] == [0, 0, 0]


# ------------------------------------------------------------------------------ fitted lines


@pytest.mark.parametrize("seed", range(4))
def test_the_fit_is_the_least_there_is(backend, seed):
    rng = np.random.default_rng(seed)
    t, angle, distance = rng.uniform(-50, 50, 60), rng.uniform(-HALF, HALF), rng.uniform(-90, 90)
    points = np.stack([distance * np.sin(angle) + t * np.cos(angle),
                       distance * np.cos(angle) - t * np.sin(angle)], 1)  # fmt: skip
    points += rng.normal(0, 2, points.shape)
    weights = rng.uniform(0, 3, 60)
    fit = cvkern.fit_line(points, weights)
    assert -HALF <= fit.theta < HALF
    # Singular values of the weighted, centred points: the smaller is what is left.
    root = np.sqrt(weights)[:, None]
    middle = (weights[:, None] * points).sum(0) / weights.sum()
    _, values, axes = np.linalg.svd(root * (points - middle), full_matrices=False)
    assert fit.rms == pytest.approx(values[1] / np.sqrt(weights.sum()), rel=1e-6)
    assert abs(axes[0] @ [np.sin(fit.theta), np.cos(fit.theta)]) < 1e-7
    through = middle @ [np.sin(fit.theta), np.cos(fit.theta)]
    assert fit.rho == pytest.approx(through, abs=1e-9)


@pytest.mark.parametrize(
    ("points", "line"),
    [
        ([[0, 3], [9, 3]], (0, 3)),
        ([[5, 0], [5, 4], [5, 9]], (-HALF, -5)),
        ([[0, 0], [4, 4]], (-HALF / 2, 0)),
        ([[0, 0], [4, -4]], (HALF / 2, 0)),
    ],
)
def test_exact_lines(backend, points, line):
    fit = cvkern.fit_line(points)
    assert (fit.theta, fit.rho, fit.rms) == pytest.approx((*line, 0), abs=1e-7)


def test_points_without_weight_do_not_count(backend):
    points = [[0, 3], [9, 3], [4, 90]]
    assert cvkern.fit_line(points, [1, 1, 0]) == cvkern.fit_line(points[:2])


# ------------------------------------------------------------------------------ photographs


def polygon(noise, seed=0):
    """Return a picture of a bright polygon, and its sides as (row, column, row, column)."""
    corners = np.array([[40, 60], [55, 250], [170, 280], [200, 90]], float)
    sides = np.hstack([corners, np.roll(corners, -1, axis=0)])
    y, x = np.mgrid[:240, :320]
    inside = np.full(y.shape, np.inf)
    for row, column, to_row, to_column in sides:
        down, along = to_row - row, to_column - column
        inside = np.minimum(
            inside, ((y - row) * along - (x - column) * down) / np.hypot(down, along)
        )
    picture = 60 + 110 * (inside + 0.5).clip(0, 1)  # a pixel's share, to a few percent
    picture = picture + np.random.default_rng(seed).normal(0, noise, picture.shape)
    return picture.clip(0, 255).astype(np.uint8), sides


def off(segment, side):
    """Return the angle between two segments, and how far the ends of one are from the other."""
    a, b = side[:2], side[2:]
    along = (b - a) / np.hypot(*(b - a))
    across = np.array([along[1], -along[0]])
    direction = segment[2:] - segment[:2]
    cosine = abs(direction @ along) / np.hypot(*direction)
    ends = segment.reshape(2, 2) - a
    return np.degrees(np.arccos(min(cosine, 1))), np.abs(ends @ across).max(), ends @ along


@pytest.mark.parametrize("noise", [0, 6])
def test_the_sides_of_a_polygon(backend, noise):
    picture, sides = polygon(noise)
    segments = cvkern.detect_segments(picture, 1.5, 48, 96).astype(float)
    lengths = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    assert (np.diff(lengths) <= 0).all()
    assert len(segments) == 4
    for side in sides:
        angle, away, along = min((off(s, side) for s in segments), key=lambda o: o[1])
        length = np.hypot(*(side[2:] - side[:2]))
        # Twice what was measured.
        assert angle < 0.035
        assert away < 0.065
        # The blurred corners are round: their edge leaves the side some pixels before its end.
        assert along.min() < 4.2
        assert along.max() > length - 4.2


def test_brightness_is_on_the_left(backend):
    """Seen with rows downwards: walking to the first side's end, the polygon is on the left."""
    picture, _ = polygon(0)
    middle = np.array([116, 170])
    for row, column, to_row, to_column in cvkern.detect_segments(picture, 1.5, 48, 96).astype(
        float
    ):
        along = np.array([to_row - row, to_column - column])
        inward = middle - [row, column]
        # (row, column) has its axes swapped: the sign of the area is that of a turn to the left.
        assert along[0] * inward[1] - along[1] * inward[0] > 0


def test_the_lines_of_a_polygon(backend):
    picture, sides = polygon(4)
    found = cvkern.detect_lines(picture, 1.5, 48, 96)
    assert len(found.rho) == 4
    assert (np.diff(found.votes) <= 0).all()
    for row, column, to_row, to_column in sides:
        fit = cvkern.fit_line([[row, column], [to_row, to_column]])
        turn = np.round((found.theta - fit.theta) / np.pi)
        angle = np.abs(found.theta - fit.theta - np.pi * turn)
        away = np.abs(found.rho * (-1) ** turn - fit.rho)
        assert ((np.degrees(angle) < 0.023) & (away < 0.09)).any()  # twice what was measured


@pytest.mark.parametrize("slope", [0.02, 0.0437, 0.05])
def test_long_lines_are_one_segment(backend, slope):
    """Lines cross some hundred bins of votes; they are put together again."""
    y, x = np.mgrid[:80, :900]
    picture = np.where(y > 20 + slope * x, 180, 40).astype(np.uint8)
    segments = cvkern.detect_segments(picture, 1.5, 40, 80)
    assert len(segments) == 1
    assert abs(segments[0, 3] - segments[0, 1]) > 880


def test_short_sides_keep_their_points(backend):
    """Sides of 18 and 36 pixels, crossed by chance lines through many of the 300 rectangles."""
    case = CASES["detect_segments"]
    (drawing,) = case.inputs((720, 960), np.random.default_rng(0))
    segments = cvkern.detect_segments(drawing, 1.5)
    assert case.difference((segments,), case.oracle(drawing)) < 0.02  # twice what was measured


def test_the_sets_find_the_same(backend):
    """Sub-pixel points differ by 1e-3 between the sets: so do ends, and few segments."""
    picture = skimage.data.camera()[100:300, 150:400]
    here = cvkern.detect_segments(picture).astype(float)
    with cvkern.use(backend="warp" if backend == "taichi" else "taichi"):
        other = cvkern.detect_segments(picture).astype(float)
    gaps = np.abs(here[:, None] - other[None]).max(axis=2).min(axis=1)
    assert len(here) > 30
    assert (gaps < 0.05).mean() > 0.95


def test_york_urban():
    """Annotated segments: angle below 2 degrees, middle within 2 pixels of one that overlaps.

    The best that cv2.HoughLinesP reached over some 330 sets of parameters is 0.509, with 17 472
    segments of 397 000 pixels in all; cv2's LSD has 0.678, with 8137 of 171 000.
    """
    folder = truth("hough") / "lines_york_urban"
    found = annotated = number = 0
    total = 0.0
    for file in sorted(folder.glob("*_gt.npz")):
        lines = np.load(file)["lines"].astype(float)[:, [1, 0, 3, 2]]
        picture = cv2.imread(str(file).replace("_gt.npz", ".jpg"), cv2.IMREAD_GRAYSCALE)
        segments = cvkern.detect_segments(picture).astype(float)
        number += len(segments)
        total += np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]).sum()
        annotated += len(lines)
        found += sum(_is_found(line, segments) for line in lines)
    assert annotated > 1000
    assert found / annotated > 0.7
    assert number < 5910
    assert total < 158_000


def _is_found(line, segments):
    begin, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    length = np.hypot(*along.T)
    along = along / length[:, None]
    direction = (line[2:] - line[:2]) / np.hypot(*(line[2:] - line[:2]))
    angle = np.degrees(np.arccos(np.abs(along @ direction).clip(max=1)))
    middle = (line[:2] + line[2:]) / 2 - begin
    away = np.abs(middle[:, 0] * along[:, 1] - middle[:, 1] * along[:, 0])
    ends = np.stack([((p - begin) * along).sum(axis=1) for p in (line[:2], line[2:])])
    overlap = np.minimum(ends.max(axis=0), length) - np.maximum(ends.min(axis=0), 0)
    return ((angle < 2) & (away < 2) & (overlap > 0)).any()


@pytest.mark.parametrize(("low", "high"), [(0.05, 1), (0.4, 8)])
def test_a_fit_that_swings_between_two_lines_ends(backend, low, high):
    """It leaves the points that it was made to, and takes none: the search must end."""
    image = np.random.default_rng(77).random((9, 7)) * 255
    votes, theta, rho = cvkern.detect_lines(image, 2.0, low, high)
    assert len(votes) == len(theta) == len(rho)
    assert len(cvkern.detect_segments(image, 2.0, low, high)) < 63
