"""Two photographs through a known homography, drawn by SciPy, and real ones with ground truth."""

import cv2
import numpy as np
import pytest
import scipy.ndimage as ndi
import skimage.data

import cvkern
from cvkern.panorama import photographs
from tests.panorama.scenes import through
from tests.truth import truth

TILTED = np.array([[0.75, 0.25, 10], [-0.1, 1.05, 30], [-4e-4, 8e-4, 1]])
SMALL = np.array([[0.45, 0.05, 2], [-0.04, 0.5, 12], [1e-4, 0, 1]])


def corners_off(found, wanted, shape):
    """Return the mean distance between the corners of a photograph under two homographies."""
    height, width = shape[:2]
    corners = np.array([[0, 0, 1], [width - 1, 0, 1], [0, height - 1, 1],
                        [width - 1, height - 1, 1]])  # fmt: skip
    a, b = corners @ np.asarray(found).T, corners @ wanted.T
    return np.hypot(*(a[:, :2] / a[:, 2:] - b[:, :2] / b[:, 2:]).T).mean()


@pytest.mark.parametrize(("matrix", "shape"), [(TILTED, (300, 240)), (SMALL, (150, 130))])
def test_corners(backend, matrix, shape):
    rng = np.random.default_rng(2)
    photo = skimage.data.immunohistochemistry()[60:300, 150:400]
    other = through(photo, matrix, shape).astype(float)
    other = 0.8 * ndi.gaussian_filter(other, (0.7, 0.7, 0)) + rng.normal(12, 4, other.shape)
    other = other.clip(0, 255).astype(np.uint8)
    found = cvkern.match_photographs(photo, other, max_keypoints=400)
    assert found.matrix is not None
    # From the plain matches they are 0.2 and 0.6 pixels off; with other noise, 0.03 to 0.12 here.
    assert corners_off(found.matrix, matrix, photo.shape) < 0.15
    there = np.c_[found.points0[:, ::-1], np.ones(len(found.points0))] @ matrix.T
    apart = there[:, :2] / there[:, 2:] - found.points1[:, ::-1]
    assert len(apart) > 100  # twice the plain matches
    assert np.median(np.hypot(*apart.T)) < 0.4
    assert np.hypot(*apart.T).max() < 3.2


def test_strangers_and_pictures_without_points():
    photo, other = skimage.data.camera()[:200, :200], skimage.data.grass()[:150, :180]
    for two in (other, np.zeros((5, 4), np.uint8)):
        matrix, points0, points1 = cvkern.match_photographs(photo, two)
        assert matrix is None
        assert points0.shape == points1.shape == (0, 2)


@pytest.mark.parametrize("swapped", [False, True])
def test_a_part_at_seven_times_the_size(swapped):
    """Without a second try, neither order of the two has a homography that is not wrong."""
    photo = skimage.data.astronaut()
    small = cv2.resize(photo, None, fx=1.5 / 7, fy=1.5 / 7, interpolation=cv2.INTER_AREA)
    part = cv2.resize(photo[179:332, 179:332], None, fx=1.5, fy=1.5, interpolation=cv2.INTER_CUBIC)
    y, x = (n / 512 for n in small.shape[:2])
    shrink = np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1]])
    grow = np.array([[1.5, 0, 0.25 - 1.5 * 179], [0, 1.5, 0.25 - 1.5 * 179], [0, 0, 1]])
    wanted = shrink @ np.linalg.inv(grow)
    found = cvkern.match_photographs(*((small, part) if swapped else (part, small)))
    assert found.matrix is not None
    matrix = np.linalg.inv(found.matrix) if swapped else found.matrix
    assert corners_off(matrix, wanted, part.shape) < 0.6


def test_a_map_to_a_line_is_none(monkeypatch):
    photo = skimage.data.camera()[:200, :200]
    assert cvkern.match_photographs(photo, photo).matrix is not None
    flat = np.array([[1.0, 0, 0], [2, 0, 0], [0, 0, 1]])
    monkeypatch.setattr(photographs, "_refined", lambda *given: flat + 1e-15)
    assert cvkern.match_photographs(photo, photo).matrix is None


@pytest.mark.parametrize(
    ("names", "file", "limit"),
    # Mean error of the corners: the best of six other libraries had 3.35, 0.94, 0.56 and 13.1.
    [
        (("graffiti/graf1.png", "graffiti/graf3.png"), "graffiti/H_1_3.txt", 1.0),
        (("v_dogman/1.png", "v_dogman/2.png"), "v_dogman/H_1_2.txt", 0.94),
        (("v_dogman/1.png", "v_dogman/3.png"), "v_dogman/H_1_3.txt", 0.56),
        (("v_dogman/1.png", "v_dogman/4.png"), "v_dogman/H_1_4.txt", 10.0),
    ],
)
def test_photographs_of_planes(names, file, limit):
    folder = truth("homography")
    a, b = (cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE) for name in names)
    assert a is not None
    assert b is not None
    found = cvkern.match_photographs(a, b)
    assert corners_off(found.matrix, np.loadtxt(folder / file), a.shape) < limit


def test_cuda_finds_what_the_cpu_finds(gpu):
    photo = skimage.data.immunohistochemistry()[60:300, 150:400]
    other = through(photo, TILTED, (300, 240))
    want = cvkern.match_photographs(photo, other, max_keypoints=400)
    with cvkern.use(device="cuda"):
        found = cvkern.match_photographs(photo, other, max_keypoints=400)
    # Drawn photographs may differ in their last bits, and so a few of their points.
    assert corners_off(found.matrix, want.matrix, photo.shape) < 0.05
