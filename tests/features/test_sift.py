"""SIFT against a NumPy statement, against OpenCV on photographs, and against itself."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.ndimage as ndi
import skimage.data
from scipy.spatial import KDTree

import cvkern
from cvkern._runtime import KERNEL_SETS
from cvkern.features._choice import best
from tests.features import reference_sift as reference
from tests.primitives import F32, I32

CAMERA = skimage.data.camera()[140:270, 180:330]


def same(a, b):
    for x, y in zip(a, b, strict=True):
        np.testing.assert_array_equal(x, y)


@pytest.fixture(scope="module")
def wanted():
    return reference.keypoints(CAMERA / 255)


def test_points_are_those_of_the_statement(backend, wanted):
    found = cvkern.sift(CAMERA, upright=True)
    ours = np.column_stack((found.points, found.scales, found.responses))
    assert len(wanted) > 100
    # Rounding to float32 decides only where a point is at a threshold: at most one of a hundred.
    for a, b in ((ours, wanted), (wanted, ours)):
        near = [np.abs(a - row).max(axis=1).min() < 2e-3 for row in b]
        assert np.mean(near) >= 0.99


def test_order_is_by_octave_level_row_and_column(backend, wanted):
    found = cvkern.sift(CAMERA, upright=True)
    if len(wanted) == len(found.points):
        np.testing.assert_allclose(found.points, wanted[:, :2], rtol=0, atol=2e-3)


@pytest.mark.parametrize("root", [True, False])
def test_descriptors_are_those_of_the_statement(backend, root):
    found = cvkern.sift(CAMERA, root=root)
    for n in range(0, len(found.points), len(found.points) // 12):
        want = reference.descriptor(
            CAMERA / 255, found.points[n], found.scales[n], found.orientations[n], root
        )
        gap = np.abs(found.descriptors[n].astype(int) - want)
        assert gap.max() <= 2  # a direction near a bin's edge, cut-offs of 2^-23
        assert gap.mean() < 0.2


def test_orientations_follow_the_image(backend):
    """Turned by 90 degrees (counter-clockwise), points and directions turn as well."""
    options = {"double": False, "contrast_threshold": 0.02}
    image = CAMERA[:129, :149]  # odd sides: every second pixel is the same from both ends
    plain, turned = cvkern.sift(image, **options), cvkern.sift(np.rot90(image), **options)
    row, column = turned.points.T
    back = np.stack((column, image.shape[1] - 1 - row), axis=1)
    distance, index = KDTree(plain.points).query(back)
    close = distance < 0.05
    assert close.mean() > 0.8
    angle = (turned.orientations + np.pi / 2 - plain.orientations[index])[close]
    off = np.abs((angle + np.pi) % (2 * np.pi) - np.pi)
    assert np.mean(off < 0.02) > 0.6  # a point with several directions may meet another of them


@pytest.mark.parametrize("sigma", [3.0, 5.0, 9.0])
def test_a_blob(backend, sigma):
    y, x = np.mgrid[:120, :140]
    image = np.exp(-((y - 57.25) ** 2 + (x - 71.5) ** 2) / (2 * sigma**2))
    found = cvkern.sift(image, 1)
    np.testing.assert_allclose(found.points[0], (57.25, 71.5), atol=0.05)
    assert abs(found.scales[0] / sigma - 1) < 0.12  # the ratio of two levels shifts it


def test_sets_and_runs_give_the_same_bits():
    color = skimage.data.astronaut()[:150, 100:280]
    for image, options in (
        (CAMERA, {}),
        (color, {"root": False, "max_keypoints": 40}),
        (CAMERA.astype(np.float32) / 255, {"double": False, "levels": 2, "spread": True}),
        (CAMERA, {"max_keypoints": 60, "spread": True, "mask": CAMERA > 40}),
    ):
        found = []
        for name in (*KERNEL_SETS, KERNEL_SETS[0]):
            with cvkern.use(backend=name):
                found.append(cvkern.sift(image, **options))
        same(found[0], found[1])
        same(found[0], found[2])


def test_a_budget_keeps_the_best(backend):
    every, some = cvkern.sift(CAMERA), cvkern.sift(CAMERA, 50)
    assert len(some.points) == 50
    order = np.argsort(-every.responses, kind="stable")[:50]
    same(some, [field[np.sort(order)] for field in every])
    assert len(cvkern.sift(CAMERA, 0).points) == 0
    assert cvkern.sift(CAMERA, 0).descriptors.shape == (0, 128)


def test_spread_reaches_more_squares(backend):
    plain, spread = (cvkern.sift(CAMERA, 40, spread=s).points // 26 for s in (False, True))
    assert len(np.unique(spread, axis=0)) > len(np.unique(plain, axis=0))


def test_mask(backend):
    mask = np.zeros(CAMERA.shape, bool)
    mask[:, :70] = True
    every, left = cvkern.sift(CAMERA), cvkern.sift(CAMERA, mask=mask)
    kept = np.floor(every.points[:, 1] + 0.5) < 70
    same(left, [field[kept] for field in every])


def test_values(backend):
    """Bytes, parts of one, 16 bits, and the grey of a colour photograph."""
    want = cvkern.sift(CAMERA)
    wide = cvkern.sift(CAMERA.astype(np.uint16) * 257)
    assert len(wide.points) == pytest.approx(len(want.points), abs=2)
    same(want, cvkern.sift(CAMERA.astype(np.float32), data_range=255))
    color = np.repeat(CAMERA[..., None], 3, axis=2)
    assert len(cvkern.sift(color).points) == pytest.approx(len(want.points), abs=3)


def test_nothing_is_found_in_nothing(backend):
    for shape in ((1, 1), (5, 40), (64, 64)):
        found = cvkern.sift(np.zeros(shape))
        assert [len(f) for f in found] == [0] * 5


def correct(found0, found1, matrix):
    """Count mutual matches that lie within 3 pixels of where a homography has them."""
    matches = cvkern.match_descriptors(found0[1], found1[1])
    x = np.c_[found0[0][matches[:, 0], ::-1], np.ones(len(matches))] @ matrix.T
    return int((np.hypot(*(x[:, :2] / x[:, 2:] - found1[0][matches[:, 1], ::-1]).T) < 3).sum())


def rootsift(image):
    points, values = cv2.SIFT.create(nfeatures=1000).detectAndCompute(image, None)  # pyright: ignore
    values = np.sqrt(values / values.sum(axis=1, keepdims=True))
    where = np.array([p.pt[::-1] for p in points])
    return where, np.minimum(512 * values + 0.5, 255).astype(np.uint8)


PAIRS = [("graffiti/graf1.png", "graffiti/graf3.png", "graffiti/H_1_3.txt")] + [
    ("v_dogman/1.png", f"v_dogman/{n}.png", f"v_dogman/H_1_{n}.txt") for n in (2, 3, 4)
]


@pytest.mark.parametrize(("one", "other", "truth"), PAIRS)
def test_quality(one, other, truth):
    """At least as many correct matches of 1000 points as OpenCV's, RootSIFT too."""
    folder = Path(os.environ.get("CVKERN_DATA", "")) / "homography"
    if not (folder / truth).is_file():
        pytest.skip("needs CVKERN_DATA")
    images = [cv2.imread(str(folder / name), 0) for name in (one, other)]
    matrix = np.loadtxt(folder / truth)
    ours = [(f.points, f.descriptors) for f in (cvkern.sift(image, 1000) for image in images)]
    theirs = [rootsift(image) for image in images]
    assert correct(ours[0], ours[1], matrix) >= correct(theirs[0], theirs[1], matrix)


def test_a_photograph_seen_through_a_homography(backend):
    photo = skimage.data.camera()[::2, ::2]
    matrix = np.array([[0.9, 0.25, 10], [-0.2, 0.95, 40], [2e-4, 1e-4, 1]])
    smooth = ndi.gaussian_filter(photo, 0.5)
    seen = cvkern.warp_perspective(smooth, matrix, dtype=np.uint8)
    pair = [(f.points, f.descriptors) for f in (cvkern.sift(i, 300) for i in (smooth, seen))]
    assert correct(pair[0], pair[1], matrix) > 90


@pytest.mark.parametrize("shape", [(100, 60), (50, 120)])
def test_squares_take_turns(shape):
    """The strongest of each square first, then the second of each, by their responses."""
    rng = np.random.default_rng(shape[0])
    points, responses = rng.random((300, 2)) * shape, rng.permutation(300).astype(np.float32)
    side = np.sqrt(4 * shape[0] * shape[1] / 40)
    squares: dict[tuple[int, int], list[int]] = {}
    for n in np.argsort(-responses):
        squares.setdefault((int(points[n, 0] // side), int(points[n, 1] // side)), []).append(n)
    ranked = [(k, -responses[n], n) for members in squares.values() for k, n in enumerate(members)]
    want = sorted(int(n) for _, _, n in sorted(ranked)[:40])
    assert best(responses, points, shape, 40, spread=True).tolist() == want


@pytest.mark.parametrize("most", [1, 40, 130, 400])
def test_kernels_choose_by_rank_value_and_place(kernels, most):
    """Against sorting; many values are equal, some are no points, and squares are of any size."""
    rng = np.random.default_rng(most)
    values = rng.integers(-30, 90, 300).astype(I32) << 20
    values[values < 0] = -1
    squares = (rng.random(300) ** 2 * 20).astype(I32)
    ranks = kernels("features.keypoints.selection.rank", values, squares, 20, out=[((300,), I32)])
    there = np.flatnonzero(values >= 0)
    better = (values > values[:, None]) | (
        (values == values[:, None]) & np.tri(300, k=-1, dtype=bool)
    )
    want = (better & (squares == squares[:, None]) & (values >= 0)).sum(axis=1)
    np.testing.assert_array_equal(ranks[there], want[there])
    for ranked in (0, 1):
        number, chosen = kernels(
            "features.keypoints.selection.choose", values, ranks, ranked,
            out=[((1,), I32), ((most,), I32)],
        )  # fmt: skip
        order = np.lexsort((there, -values[there], ranks[there] * ranked))[:most]
        assert chosen[: number[0]].tolist() == np.sort(there[order]).tolist()


def test_extrema_that_move_beyond_the_levels_are_left_out(kernels):
    """Memory goes on behind an octave, with the very extremum that must not be looked for there."""
    s, y, x = np.ogrid[:7, :11, :12]
    differences = 1 - 0.02 * (s - 4.0) ** 2 - 0.01 * ((y - 5) ** 2 + (x - 6) ** 2)
    levels = np.concatenate([np.zeros((1, 11, 12)), np.cumsum(differences, axis=0)]).astype(F32)
    for count, kept in ((6, -1), (7, 0)):
        octave = kernels._adopt(levels[:count])
        _, cells = kernels(
            "features.keypoints.refinement.refine", [octave], 0.5, 12.1, 2,
            out=[((1, 4), F32), np.array([[0, 3, 5, 6]], I32)],
        )  # fmt: skip
        assert cells.tolist() == [[kept, 4, 5, 6]]


@pytest.mark.parametrize("step", [(0, 1), (0, -1), (1, 0), (-1, 0)])
def test_extrema_that_move_into_the_margin_are_left_out(kernels, step):
    """The margin is 2 pixels wide; one that stays at the last pixel before it is kept."""
    down, along = step
    at = 5 + 3 * down, 6 + 4 * along - (along > 0)  # 11 rows and 12 columns
    for beyond, kept in ((0, 0), (1, -1)):
        row, column = at[0] + beyond * down, at[1] + beyond * along
        s, y, x = np.ogrid[:5, :11, :12]
        differences = 1 - 0.02 * (s - 2.0) ** 2 - 0.01 * ((y - row) ** 2 + (x - column) ** 2)
        levels = np.concatenate([np.zeros((1, 11, 12)), np.cumsum(differences, axis=0)])
        _, cells = kernels(
            "features.keypoints.refinement.refine", [kernels._adopt(levels.astype(F32))], 0.5,
            12.1, 2, out=[((1, 4), F32), np.array([[0, 2, *at]], I32)],
        )  # fmt: skip
        assert cells.tolist() == [[kept, 2, row, column]]


@pytest.mark.parametrize(("off", "kept"), [(2, 0), (4, -1)])
def test_extrema_that_would_move_far_are_left_out(kernels, off, kept):
    """Beyond two pixels the fit means nothing, even where it is exact."""
    s, y, x = np.ogrid[:5, :9, :16]
    differences = 1 - 0.02 * (s - 2.0) ** 2 - 0.01 * ((y - 4) ** 2 + (x - 5 - off) ** 2)
    levels = np.concatenate([np.zeros((1, 9, 16)), np.cumsum(differences, axis=0)])
    _, cells = kernels(
        "features.keypoints.refinement.refine", [kernels._adopt(levels.astype(F32))], 0.5, 12.1,
        2, out=[((1, 4), F32), np.array([[0, 2, 4, 5]], I32)],
    )  # fmt: skip
    assert cells[0, 0] == kept


@pytest.mark.parametrize(("stretch", "kept"), [(9.9, 0), (10.1, -1)])
def test_extrema_that_are_too_long_are_left_out(kernels, stretch, kept):
    """Edges: of curvatures a and b, (a + b)^2 / (a b) must be below 11^2 / 10."""
    s, y, x = np.ogrid[:5, :9, :9]
    differences = 1 - 0.02 * (s - 2.0) ** 2 - 0.01 * ((y - 4) ** 2 + (x - 4) ** 2 / stretch)
    levels = np.concatenate([np.zeros((1, 9, 9)), np.cumsum(differences, axis=0)])
    _, cells = kernels(
        "features.keypoints.refinement.refine", [kernels._adopt(levels.astype(F32))], 0.5, 12.1,
        2, out=[((1, 4), F32), np.array([[0, 2, 4, 4]], I32)],
    )  # fmt: skip
    assert cells[0, 0] == kept
