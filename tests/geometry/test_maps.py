"""Robust maps between images: rendered truth, photographs with truth, degenerate and bad input."""

import numpy as np
import pytest

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.refusals import refused
from tests.truth import truth

CORNERS = np.array([[0.0, 0], [0, 639], [479, 639], [479, 0]])  # rows, columns
FINDS = {
    "homography": cvkern.find_homography,
    "affine": cvkern.find_affine,
    "similarity": cvkern.find_similarity,
}


def through(matrix, points):
    """Map points (row, column) by a matrix that acts on (x, y, 1)."""
    q = np.c_[points[:, ::-1], np.ones(len(points))] @ np.asarray(matrix).T
    return (q[:, :2] / q[:, 2:])[:, ::-1]


def random_map(rng, kind="homography"):
    moved = CORNERS + rng.uniform(-90, 90, (4, 2))
    fits = {
        "homography": cvkern.fit_homography,
        "affine": cvkern.fit_affine,
        "similarity": cvkern.fit_similarity,
    }
    return fits[kind](CORNERS, moved)


def scene(seed, count=400, outliers=0.5, noise=1.0, kind="homography"):
    """Matches of a known map: (points0, points1, matrix, which are outliers)."""
    rng = np.random.default_rng(seed)
    matrix = random_map(rng, kind)
    a = rng.uniform(0, (480, 640), (count, 2))
    b = through(matrix, a) + rng.normal(0, noise, (count, 2))
    wild = rng.permutation(count) < round(outliers * count)
    b[wild] = rng.uniform(0, (480, 640), (wild.sum(), 2))
    return a, b, matrix, wild


def corner_error(found, matrix):
    return np.linalg.norm(through(found, CORNERS) - through(matrix, CORNERS), axis=1).mean()


# Limits of the mean corner error: the least-squares fit to the true inliers has about a third.
@pytest.mark.parametrize(
    ("outliers", "noise", "limit"),
    [(0.0, 0.0, 1e-3), (0.0, 1.0, 1.0), (0.3, 0.1, 0.1), (0.5, 1.0, 1.5), (0.8, 0.5, 1.2)],
)
@pytest.mark.parametrize("kind", FINDS)
def test_finds_the_truth(backend, kind, outliers, noise, limit):
    for seed in range(4):
        a, b, matrix, _wild = scene(seed, outliers=outliers, noise=noise, kind=kind)
        fit = FINDS[kind](a, b)
        assert fit.matrix is not None
        assert fit.matrix.dtype == np.float64
        assert corner_error(fit.matrix, matrix) < limit
        assert fit.inliers.dtype == bool
        near = np.linalg.norm(through(matrix, a) - b, axis=1) < 3
        assert np.mean(fit.inliers == near) > 0.97
        residual = np.linalg.norm(through(fit.matrix, a) - b, axis=1)
        # Costs are in units of 1 / 4096 for each match, residuals in float32.
        right = np.minimum((residual / 3) ** 2, 1).sum()
        assert fit.cost == pytest.approx(right, abs=len(a) / 4096)
        assert np.sum(fit.inliers != (residual < 3)) <= 1


def test_inliers_are_used_as_by_least_squares():
    """With the outliers far away the fit is that of the inliers alone."""
    a, b, _, wild = scene(3, outliers=0.4, noise=0.3, kind="affine")
    b[wild] += 5000
    fit = cvkern.find_affine(a, b)
    right = cvkern.fit_affine(a[~wild], b[~wild])
    assert corner_error(fit.matrix, right) < 1e-3


@pytest.mark.parametrize("kind", FINDS)
def test_order_does_not_matter(kind):
    a, b, _, _ = scene(0, count=301, kind=kind)
    a[5], b[5] = a[9], b[9]
    fit = FINDS[kind](a, b)
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(len(a))
        again = FINDS[kind](a[order], b[order])
        np.testing.assert_array_equal(again.matrix, fit.matrix)
        np.testing.assert_array_equal(again.inliers, fit.inliers[order])
        assert again.cost == fit.cost


def test_a_batch_is_each_pair_alone(backend):
    scenes = [scene(i, 40 + 60 * i, 0.1 * i) for i in range(9)]
    bad = np.full((30, 2), np.nan)
    few = CORNERS[:3]
    line = np.arange(60.0).reshape(30, 2)
    none = np.empty((0, 2))
    pairs = [(a, b) for a, b, _, _ in scenes]
    pairs[2:2] = [(bad, bad), (few, few), (none, none), (line, line), (line * 0, line)]
    fits = cvkern.find_homographies(pairs)
    assert np.isnan(fits.matrices[2:7]).all()
    assert fits.costs[2:7].tolist() == [30, 3, 0, 30, 30]
    assert fits.offsets.tolist() == np.cumsum([0] + [len(a) for a, _ in pairs]).tolist()
    for i, (a, b) in enumerate(pairs):
        alone = cvkern.find_homography(a, b)
        np.testing.assert_array_equal(
            fits.inliers[fits.offsets[i] : fits.offsets[i + 1]], alone.inliers
        )
        if alone.matrix is None:
            assert np.isnan(fits.matrices[i]).all()
            assert not alone.inliers.any()
        else:
            np.testing.assert_array_equal(fits.matrices[i], alone.matrix)
        assert fits.costs[i] == alone.cost
    reverse = cvkern.find_homographies(pairs[::-1])
    np.testing.assert_array_equal(reverse.matrices[::-1], fits.matrices)


@pytest.mark.parametrize("kind", FINDS)
def test_equal_bits(kind):
    answers = []
    for name in KERNEL_SETS:
        with cvkern.use(backend=name):
            answers.append([FINDS[kind](*scene(i, 200, 0.6, kind=kind)[:2]) for i in range(3)])
    for one, other in zip(*answers, strict=True):
        np.testing.assert_array_equal(one.matrix, other.matrix)
        np.testing.assert_array_equal(one.inliers, other.inliers)
        assert one.cost == other.cost


def test_outliers_alone_have_no_map():
    for seed in range(5):
        a, b, _, _ = scene(seed, 300, 1.0)
        for find in FINDS.values():
            fit = find(a, b, max_trials=4096)
            assert fit.matrix is None
            assert not fit.inliers.any()
            assert fit.cost == 300


def test_matches_that_are_not_finite_are_outliers():
    a, b, _, _ = scene(1)
    right = cvkern.find_homography(a, b)
    a2 = np.r_[[[np.nan, 3]], a, [[4, 5]]]
    b2 = np.r_[[[1, 3]], b, [[np.inf, 5]]]
    fit = cvkern.find_homography(a2, b2)
    np.testing.assert_array_equal(fit.matrix, right.matrix)
    assert fit.inliers.tolist() == [False, *right.inliers, False]
    assert fit.cost == right.cost + 2


def test_equal_matches_count_once_and_are_marked_each():
    a, b, _, _ = scene(1, 100)
    right = cvkern.find_homography(a, b)
    fit = cvkern.find_homography(np.r_[a, a[:50], a[:50]], np.r_[b, b[:50], b[:50]])
    np.testing.assert_array_equal(fit.matrix, right.matrix)
    np.testing.assert_array_equal(
        fit.inliers, np.r_[right.inliers, right.inliers[:50], right.inliers[:50]]
    )
    assert fit.cost == right.cost


def test_four_matches_are_enough_where_all_agree():
    b = CORNERS + np.array([[3, 1], [0, 5], [9, 0], [2, 2]])
    fit = cvkern.find_homography(CORNERS, b)
    np.testing.assert_allclose(through(fit.matrix, CORNERS), b, atol=1e-3)
    assert fit.inliers.all()
    assert cvkern.find_homography(CORNERS[[0, 1, 2, 2]], b).matrix is None
    folded = b[[0, 2, 1, 3]]  # crosses over: a part would be behind the camera
    assert cvkern.find_homography(CORNERS, folded, 1.0).matrix is None


def test_images_of_other_sizes_and_places():
    a, b, matrix, _ = scene(2)
    for scale, shift in ((0.01, 0), (1, 1e5), (30, -4e4)):
        fit = cvkern.find_homography(a, b * scale + shift, 3.0 * scale)
        mapped = (through(fit.matrix, CORNERS) - shift) / scale
        error = np.linalg.norm(mapped - through(matrix, CORNERS), axis=1).mean()
        assert error < 1.5


def test_mirrored_images():
    a, b, _, _ = scene(4)
    fit = cvkern.find_homography(a, b * (1, -1))
    right = cvkern.find_homography(a, b)
    assert np.mean(fit.inliers == right.inliers) > 0.98


def test_options():
    a, b, _matrix, _ = scene(6, 200, 0.7)
    one, other = (cvkern.find_homography(a, b, seed=seed) for seed in (0, 1))
    assert corner_error(one.matrix, other.matrix) < 1
    few = cvkern.find_homography(a, b, max_trials=1)
    assert few.matrix is None or np.isfinite(few.matrix).all()
    wide = cvkern.find_homography(a, b, 6.0)
    assert wide.inliers.sum() > one.inliers.sum()


def test_other_libraries():
    torch = pytest.importorskip("torch")
    a, b, _, _ = scene(0)
    right = cvkern.find_homography(a, b)
    fit = cvkern.find_homography(torch.from_numpy(a), torch.from_numpy(b))
    assert isinstance(fit.inliers, torch.Tensor)
    np.testing.assert_array_equal(fit.inliers.numpy(), right.inliers)
    np.testing.assert_array_equal(fit.matrix, right.matrix)


@pytest.mark.parametrize("name", KERNEL_SETS)
def test_on_a_gpu(gpu, name):
    a, b, _, _ = scene(0, 2000, 0.8)
    right = cvkern.find_homography(a, b)
    with cvkern.use(backend=name, device="cuda"):
        fit = cvkern.find_homography(a, b)
    np.testing.assert_array_equal(fit.matrix, right.matrix)
    np.testing.assert_array_equal(fit.inliers, right.inliers)
    assert fit.cost == right.cost


def test_photographs_of_planes():
    """The mean error on hand-made points is 1.49 for the best of other libraries."""
    errors = []
    for path in sorted((truth("homography") / "homogr").glob("*.npz")):
        data = np.load(path)
        x = data["tentative"]
        fit = cvkern.find_homography(x[:, 1::-1], x[:, :1:-1])
        points = data["gt_points"]
        gaps = through(fit.matrix, points[:, 1::-1]) - points[:, :1:-1]
        errors.append(np.sqrt(np.mean(np.sum(gaps**2, axis=1))))
    assert len(errors) == 7
    assert max(errors) < 3
    assert np.mean(errors) < 1.49


@pytest.mark.parametrize(("outliers", "limit"), [(0.5, 0.15), (0.8, 0.23)])
def test_accuracy_of_many_scenes(outliers, limit):
    scenes = [scene(100 + i, 2000, outliers) for i in range(100)]
    fits = cvkern.find_homographies([(a, b) for a, b, _, _ in scenes])
    errors = [corner_error(m, s[2]) for m, s in zip(fits.matrices, scenes, strict=True)]
    assert max(errors) < 1
    assert np.median(errors) < limit


@pytest.mark.parametrize("kind", FINDS)
def test_refusals(kind):
    find = FINDS[kind]
    refused(ValueError, "threshold must be > 0, got 0", find, CORNERS, CORNERS, 0)
    refused(TypeError, "threshold must be a number, got 'a'", find, CORNERS, CORNERS, "a")
    for confidence in (0, 1):
        message = f"confidence must be in (0, 1), got {confidence}"
        refused(ValueError, message, find, CORNERS, CORNERS, confidence=confidence)
    message = f"max_trials must be in [1, {2**30}], got 0"
    refused(ValueError, message, find, CORNERS, CORNERS, max_trials=0)
    message = f"seed must be in [0, {2**31 - 1}], got -1"
    refused(ValueError, message, find, CORNERS, CORNERS, seed=-1)
    refused(ValueError, "points1 must be as many as points0, 4, got 3", find, CORNERS, CORNERS[:3])
    message = "points1 must have shape (N, 2), got (4, 3)"
    refused(ValueError, message, find, CORNERS, np.zeros((4, 3)))
    many = np.broadcast_to(0.0, (2**18 + 1, 2))
    message = "points0 must be at most 262144, got 262145"
    refused(ValueError, message, find, many, many)
