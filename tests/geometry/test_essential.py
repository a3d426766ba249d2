"""Essential matrices: rendered truth, planes, photographs, degenerate and bad input."""

import json
from typing import Any

import cv2
import numpy as np
import pytest

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.geometry.reference_robust import ROTATION, TRANSLATION
from tests.geometry.test_epipolar import CAMERA, scene
from tests.refusals import refused
from tests.truth import truth


def errors(matrix, a, b, rotation, translation, camera=CAMERA):
    """Angles, in degrees, between poses and between directions of translation."""
    pose = cvkern.recover_pose(matrix, a, b, camera, camera)
    turn = 2 * np.arcsin(np.linalg.norm(pose.rotation - rotation) / np.sqrt(8))
    along = pose.translation @ translation / np.linalg.norm(translation)
    return np.degrees([turn, np.arccos(np.clip(along, -1, 1))])


@pytest.mark.parametrize(
    ("outliers", "noise", "limits"),
    [(0.0, 0.0, (1e-3, 1e-3)), (0.3, 0.1, (0.1, 0.5)), (0.6, 0.3, (0.3, 1.2))],
)
def test_finds_the_truth(outliers, noise, limits):
    for seed in range(3):
        a, b, wild = scene(seed, 300, outliers, noise)
        fit = cvkern.find_essential(a, b, CAMERA, CAMERA)
        assert fit.matrix is not None
        np.testing.assert_allclose(np.linalg.svd(fit.matrix)[1], (1, 1, 0), atol=1e-12)
        near = errors(fit.matrix, a[fit.inliers], b[fit.inliers], ROTATION, TRANSLATION)
        assert (near < limits).all()
        inverse = np.linalg.inv(CAMERA)
        close = cvkern.sampson_distance(inverse.T @ fit.matrix @ inverse, a, b) < 1
        assert np.sum(close != fit.inliers) <= 1
        assert fit.inliers[~wild].mean() > 0.9


def test_a_wide_threshold_loses_little():
    """The last weights suit the noise, .2 pixels; with those of 4 pixels the error is a degree."""
    found = {1.0: [], 4.0: []}
    for seed in range(4):
        a, b, _ = scene(seed, 300, 0.4, 0.2)
        for threshold, errors_of in found.items():
            fit: Any = cvkern.find_essential(a, b, CAMERA, CAMERA, threshold)
            inside = fit.inliers
            errors_of.append(errors(fit.matrix, a[inside], b[inside], ROTATION, TRANSLATION))
    narrow, wide = (np.mean(errors_of, axis=0) for errors_of in found.values())
    assert (wide < 1.5 * narrow).all()


def test_calls_before_change_nothing(backend):
    """Scratch memory that is large enough from the start is not replaced between the steps."""
    for seed in (0, 1, 3):
        a, b, _ = scene(seed, 300, 0.4, 0.2)
        pairs = [scene(100 + n, 40, 0.2, 0.2)[:2] for n in range(9)]
        cvkern.find_essentials(pairs, CAMERA, CAMERA)
        after = cvkern.find_essential(a, b, CAMERA, CAMERA, 4.0)
        cvkern.release_memory()
        alone = cvkern.find_essential(a, b, CAMERA, CAMERA, 4.0)
        assert (after.matrix == alone.matrix).all()


def test_a_plane_does_not_deceive():
    """Nine of ten points on a plane: seven points would fix nothing, five do."""
    for seed in range(3):
        a, b, _ = scene(seed, 300, 0.2, 0.2, 0.9)
        fit = cvkern.find_essential(a, b, CAMERA, CAMERA)
        assert (errors(fit.matrix, a, b, ROTATION, TRANSLATION) < (0.5, 2)).all()


def test_two_cameras():
    """The second picture at half size, moved; a skew. The threshold is in pixels of its own."""
    a, b, _ = scene(0, 200, 0.2, 0.1)
    second = np.array([[0.5, 0.02, 11], [0, 0.5, -7], [0, 0, 1]])
    moved = (np.c_[b[:, ::-1], np.ones(200)] @ second.T)[:, 1::-1]
    fit: Any = cvkern.find_essential(a, moved, CAMERA, second @ CAMERA)
    one = cvkern.recover_pose(fit.matrix, a, moved, CAMERA, second @ CAMERA)
    assert np.abs(one.rotation - ROTATION).max() < 0.005
    # A camera matrix has no scale.
    other: Any = cvkern.find_essential(a, moved, 2 * CAMERA, 3 * second @ CAMERA)
    np.testing.assert_allclose(other.matrix, fit.matrix, atol=1e-9)


def test_order_and_batch_do_not_matter():
    pairs = [scene(i, 60 + 40 * i, 0.2)[:2] for i in range(3)]
    few = np.arange(10.0).reshape(5, 2)
    pairs[1:1] = [(few, few + 1), (np.full((20, 2), np.nan), np.zeros((20, 2)))]
    cameras = np.stack([CAMERA] * 5)
    fits = cvkern.find_essentials(pairs, cameras, CAMERA)
    once = cvkern.find_essentials(iter(pairs), cameras, CAMERA)  # pyright: ignore[reportArgumentType]
    np.testing.assert_array_equal(once.matrices, fits.matrices)
    assert np.isnan(fits.matrices[1:3]).all()
    assert fits.costs[1:3].tolist() == [5, 20]
    for i in (0, 3, 4):
        a, b = pairs[i]
        order = np.random.default_rng(i).permutation(len(a))
        alone = cvkern.find_essential(a[order], b[order], CAMERA, CAMERA)
        np.testing.assert_array_equal(alone.matrix, fits.matrices[i])
        inliers = fits.inliers[fits.offsets[i] : fits.offsets[i + 1]]
        np.testing.assert_array_equal(alone.inliers, inliers[order])


def test_equal_bits():
    answers = []
    for name in KERNEL_SETS:
        with cvkern.use(backend=name):
            a, b, _ = scene(2, 120, 0.4)
            answers.append(cvkern.find_essential(a, b, CAMERA, CAMERA, max_trials=512))
    one, other = answers
    np.testing.assert_array_equal(one.matrix, other.matrix)
    np.testing.assert_array_equal(one.inliers, other.inliers)
    assert one.cost == other.cost


def test_outliers_alone_have_no_geometry():
    a, b, _ = scene(0, 200, 1.0)
    fit = cvkern.find_essential(a, b, CAMERA, CAMERA, max_trials=2048)
    assert fit.matrix is None
    assert not fit.inliers.any()


@pytest.mark.parametrize("name", KERNEL_SETS)
def test_on_a_gpu(gpu, name):
    a, b, _ = scene(0, 1000, 0.5)
    right: Any = cvkern.find_essential(a, b, CAMERA, CAMERA)
    with cvkern.use(backend=name, device="cuda"):
        fit: Any = cvkern.find_essential(a, b, CAMERA, CAMERA)
    if name == "warp":
        np.testing.assert_array_equal(fit.matrix, right.matrix)
    np.testing.assert_allclose(fit.matrix, right.matrix, atol=1e-6)
    np.testing.assert_array_equal(fit.inliers, right.inliers)


def test_photographs():
    """Neighbours of fountain-P11, matches by OpenCV's SIFT; PoseLib has .024 and .071 degrees."""
    folder = truth("two_view") / "strecha_fountain_P11"
    cameras = json.loads((folder / "cameras.json").read_text())
    names = sorted(cameras)[:5]
    found = []
    sift = cv2.SIFT.create()
    photos: list[Any] = [cv2.imread(str(folder / name), 0) for name in names]
    nothing: Any = None
    seen = [sift.detectAndCompute(photo, nothing) for photo in photos]
    for i in range(4):
        matches = cv2.BFMatcher().knnMatch(seen[i][1], seen[i + 1][1], k=2)
        good = [one for one, other in matches if one.distance < 0.8 * other.distance]
        a = np.array([seen[i][0][m.queryIdx].pt[::-1] for m in good])
        b = np.array([seen[i + 1][0][m.trainIdx].pt[::-1] for m in good])
        one, other = (cameras[names[k]] for k in (i, i + 1))
        camera = np.array(one["K"])
        turn = np.array(other["R_world_to_cam"]) @ np.array(one["R_world_to_cam"]).T
        shift = np.array(other["t"]) - turn @ one["t"]
        fit = cvkern.find_essential(a, b, camera, camera, 0.5)
        inside = fit.inliers
        found.append(errors(fit.matrix, a[inside], b[inside], turn, shift, camera))
    assert (np.mean(found, 0) < (0.035, 0.1)).all()


def test_refusals():
    a, b, _ = scene(0, 20)
    singular = np.diag((1.0, 1.0, 0.0))
    message = "K1 must have an inverse, got a matrix of rank below 3"
    refused(ValueError, message, cvkern.find_essential, a, b, CAMERA, singular)
    message = "K0 must have shape (3, 3) or (1, 3, 3), got (2, 3, 3)"
    refused(ValueError, message, cvkern.find_essentials, [(a, b)], np.zeros((2, 3, 3)), CAMERA)
    refused(
        ValueError, "threshold must be > 0, got 0", cvkern.find_essential, a, b, CAMERA, CAMERA, 0
    )
    refused(
        ValueError, "pairs must not be empty, got none", cvkern.find_essentials, [], CAMERA, CAMERA
    )
