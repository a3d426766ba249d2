"""Least-squares maps between matched points, against scikit-image and closed forms."""

import numpy as np
import pytest
import skimage.transform

import cvkern
from tests.refusals import refused

SQUARE = np.array([[0.0, 0], [0, 200], [150, 210], [160, 10]])
TRUE = np.array([[1.1, 0.1, 30], [-0.05, 0.9, 12], [2e-4, -1e-4, 1]])
FITS = {
    "homography": (cvkern.fit_homography, skimage.transform.ProjectiveTransform, 4),
    "affine": (cvkern.fit_affine, None, 3),
    "similarity": (cvkern.fit_similarity, skimage.transform.SimilarityTransform, 2),
}


def through(matrix, points):
    """Map points (row, column) by a matrix that acts on (x, y, 1)."""
    q = np.c_[points[:, ::-1], np.ones(len(points))] @ matrix.T
    return (q[:, :2] / q[:, 2:])[:, ::-1]


def matches(count, noise=0.0, seed=0, matrix=TRUE):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, (300, 400), (count, 2))
    return points, through(matrix, points) + rng.normal(0, noise, (count, 2))


@pytest.mark.parametrize("name", FITS)
@pytest.mark.parametrize("count", [4, 5, 60])
def test_is_what_others_find(name, count):
    fit, transform, _ = FITS[name]
    a, b = matches(count, noise=0.5)
    x, u = a[:, ::-1], b[:, ::-1]
    if transform:
        right = transform.from_estimate(x, u).params
    else:  # scikit-image's affine map is no least squares in the second image
        right = np.linalg.lstsq(np.c_[x, np.ones(count)], u, rcond=None)[0].T
        right = np.vstack((right, (0, 0, 1)))
    # Scikit-image scales points by the root of the mean square, so the equations of a homography
    # have slightly other weights, which move these points by 2e-5 pixels under noise of 0.5. The
    # others differ by rounding.
    atol = 1e-4 if name == "homography" and count > 4 else 1e-8
    np.testing.assert_allclose(through(fit(a, b), a), through(right, a), rtol=0, atol=atol)


@pytest.mark.parametrize("name", FITS)
def test_a_minimal_sample_is_met_exactly(name):
    fit, _, least = FITS[name]
    a, b = matches(least, noise=3.0, seed=2)
    np.testing.assert_allclose(through(fit(a, b), a), b, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", FITS)
def test_weights_count_as_copies(name):
    fit, _, _ = FITS[name]
    a, b = matches(12, noise=2.0)
    copies = np.arange(12) % 4
    one = fit(a, b, copies)
    other = fit(np.repeat(a, copies, 0), np.repeat(b, copies, 0))
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    assert np.abs(one - fit(a, b)).max() > 1e-3


def test_least_squares_are_the_least():
    a, b = matches(30, noise=2.0)
    for name, free in (("affine", 6), ("similarity", 4)):
        best = FITS[name][0](a, b)
        least = np.sum((through(best, a) - b) ** 2)
        for i in range(free):
            for step in (-1e-3, 1e-3):
                other = best.copy()
                if name == "affine":
                    other[i // 3, i % 3] += step
                else:
                    turn = np.array([[1, 0, 0], [0, 1, 0]]), np.array([[0, -1, 0], [1, 0, 0]])
                    shift = np.array([[0, 0, 1], [0, 0, 0]]), np.array([[0, 0, 0], [0, 0, 1]])
                    other[:2] += step * (*turn, *shift)[i]
                assert np.sum((through(other, a) - b) ** 2) > least


def test_a_map_that_sends_the_origin_to_infinity():
    matrix = np.array([[1.0, 0, 5], [0, 1, 3], [0.1, 0.2, 0]])
    a, b = matches(9, matrix=matrix)
    found = cvkern.fit_homography(a, b)
    assert found[2, 2] == pytest.approx(0, abs=1e-9) or np.abs(found).max() > 1e6
    np.testing.assert_allclose(through(found, a), b, rtol=1e-6)


def test_lists_and_other_libraries():
    torch = pytest.importorskip("torch")
    a, b = matches(8, noise=1.0)
    right = cvkern.fit_homography(a, b)
    np.testing.assert_array_equal(cvkern.fit_homography(a.tolist(), b.tolist()), right)
    given = torch.from_numpy(a), torch.from_numpy(b)
    np.testing.assert_array_equal(cvkern.fit_homography(*given), right)


ON_A_LINE = np.array([[0, 0], [1, 1], [2, 2], [3, 5.0]])


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (ON_A_LINE, SQUARE),
        (SQUARE, ON_A_LINE),
        (ON_A_LINE, ON_A_LINE),
        (SQUARE[[0, 1, 2, 2]], SQUARE[[0, 1, 2, 2]]),
        (np.zeros((6, 2)), np.zeros((6, 2))),
        (np.arange(20.0).reshape(10, 2), np.arange(20.0).reshape(10, 2)),
    ],
)
def test_degenerate_homographies_are_refused(a, b):
    message = (
        "points0 and points1 must determine a homography, got points too many of which are "
        "on one line, or one point"
    )
    refused(ValueError, message, cvkern.fit_homography, a, b)


def test_degenerate_maps_are_refused():
    line = np.arange(8.0).reshape(4, 2) * 3
    message = "points0 must determine an affine map, got points that are all on one line"
    refused(ValueError, message, cvkern.fit_affine, line, SQUARE)
    message = "points0 must be two or more, in different places, got one place"
    refused(ValueError, message, cvkern.fit_similarity, np.full((4, 2), 7.5), SQUARE)


@pytest.mark.parametrize("name", FITS)
def test_refusals(name):
    fit, _, least = FITS[name]
    noun = {"homography": "a homography", "affine": "an affine map", "similarity": "a similarity"}
    message = f"points0 must be at least {least} for {noun[name]}, got {least - 1}"
    refused(ValueError, message, fit, SQUARE[: least - 1], SQUARE[: least - 1])
    refused(ValueError, message, fit, SQUARE, SQUARE, [1] * (least - 1) + [0] * (5 - least))
    refused(ValueError, "points1 must be as many as points0, 4, got 3", fit, SQUARE, SQUARE[:3])
    message = "points0 must have shape (N, 2), got (4, 3)"
    refused(ValueError, message, fit, np.zeros((4, 3)), SQUARE)
    refused(ValueError, "weights must be >= 0 and finite, got -1", fit, SQUARE, SQUARE, [-1] * 4)
    refused(ValueError, "weights must have shape (4,), got (3,)", fit, SQUARE, SQUARE, [1] * 3)
    wrong = SQUARE.copy()
    wrong[1, 0] = np.nan
    refused(
        ValueError, "points1 must be finite in float32, got some that are not", fit, SQUARE, wrong
    )
    message = "points0 must hold real numbers, got dtype complex128"
    refused(TypeError, message, fit, SQUARE.astype(complex), SQUARE)
