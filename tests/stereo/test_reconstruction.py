"""From two photographs to depth: against a laser scanner's truth, turned and swapped cameras."""

import warnings

import numpy as np
import pytest
import skimage.data

import cvkern
from cvkern.images import write_image
from cvkern.stereo.reconstruction import _dense, _depths, _reduced
from tests.refusals import refused

STEP = 2  # photographs at half size
BASELINE = 0.193
K0 = np.array([[994.978 / STEP, 0, 311.193 / STEP], [0, 994.978 / STEP, 254.877 / STEP], [0, 0, 1]])
K1 = K0 + np.array([[0, 0, 31.086 / STEP], [0, 0, 0], [0, 0, 0]])


@pytest.fixture(scope="module")
def motorcycle():
    """Both photographs, and the true depth of the left one in metres."""
    left, right, disparity = skimage.data.stereo_motorcycle()
    small = [
        np.rint(cvkern.resize(photo, (250, 370), channel_axis=-1)).astype(np.uint8)
        for photo in (left, right)
    ]
    known = disparity[::STEP, ::STEP][:250, :370]
    known = np.where(np.isfinite(known), known, np.nan)
    depth = 994.978 * BASELINE / (known + 31.086)
    return *small, depth


def turned(angles):
    """A rotation by Cayley's formula."""
    cross = np.cross(np.eye(3), np.asarray(angles) / 2)
    return np.linalg.solve(np.eye(3) + cross, np.eye(3) - cross)


def gaps(pair, truth, matrix=None):
    """Relative errors of depth at the pixels of the first photograph, where it is known."""
    matrix = pair.H0 if matrix is None else pair.H0 @ matrix
    y, x = np.indices(truth.shape)
    q = np.stack((x, y, np.ones_like(x)), -1).reshape(-1, 3) @ matrix.T
    column, row = np.rint(q[:, :2] / q[:, 2:]).astype(int).T
    height, width = pair.depth.shape
    inside = (row >= 0) & (column >= 0) & (row < height) & (column < width)
    depth = np.full(truth.size, np.nan)
    depth[inside] = pair.depth[row[inside], column[inside]]
    error = np.abs(depth / truth.ravel() - 1)
    return error[np.isfinite(error)]


def test_depth_is_the_scanners(motorcycle):
    left, right, truth = motorcycle
    pair = cvkern.reconstruct_pair(left, right, np.stack((K0, K1)), BASELINE)
    error = gaps(pair, truth)
    assert len(error) > 0.6 * truth.size
    assert np.median(error) < 0.02
    assert (error < 0.05).mean() > 0.85
    assert np.abs(pair.rotation - np.eye(3)).max() < 0.005
    assert np.linalg.norm(pair.translation) == pytest.approx(BASELINE)
    assert pair.translation[0] < -0.999 * BASELINE  # the second camera is to the right
    # Sparse points are where the dense ones are.
    row, column = np.rint(pair.places).astype(int).T
    inside = (row >= 0) & (column >= 0) & (row < 250) & (column < 370)
    near = pair.valid[row[inside], column[inside]]
    dense = pair.disparity[row[inside], column[inside]][near]
    assert np.median(np.abs(dense - pair.sparse_disparity[inside][near])) < 0.3
    assert len(pair.cloud.points) == pair.valid.sum() == np.isfinite(pair.depth).sum()
    np.testing.assert_array_equal(pair.cloud.points[:, 2], pair.depth[pair.valid])


def test_turned_and_swapped_cameras(motorcycle):
    """The right camera first, and the left one turned by 9 degrees: the same depths."""
    left, right, truth = motorcycle
    rotation = turned((0.05, -0.1, 0.12))
    matrix = K0 @ rotation @ np.linalg.inv(K0)
    seen = cvkern.warp_perspective(left, matrix, left.shape[:2], channel_axis=-1, dtype=np.uint8)
    pair = cvkern.reconstruct_pair(seen, right, np.stack((K0, K1)), BASELINE)
    assert np.abs(pair.rotation @ rotation - np.eye(3)).max() < 0.01
    # Depth of the turned camera is along its own axis.
    y, x = np.indices(truth.shape)
    rays = np.stack((x, y, np.ones_like(x)), -1) @ np.linalg.inv(K0).T
    own = truth * (rays @ rotation.T)[..., 2]
    assert np.median(gaps(pair, own, matrix)) < 0.02
    swapped = cvkern.reconstruct_pair(right, seen, np.stack((K1, K0)), BASELINE)
    both = [np.nanmedian(p.depth) for p in (pair, swapped)]
    assert both[0] == pytest.approx(both[1], rel=0.15)
    assert np.median(swapped.sparse_disparity[swapped.points[:, 2] < both[1]]) < np.median(
        swapped.sparse_disparity[swapped.points[:, 2] > both[1]]
    )  # mirrored: near points have the smaller disparity


def test_without_a_camera(motorcycle, tmp_path):
    """A focal length is guessed, loudly; of a file it is that of the EXIF."""
    left, right, _ = motorcycle
    with pytest.warns(UserWarning, match=r"is guessed of image0 \(444 pixels\) and image1 \("):
        pair = cvkern.reconstruct_pair(left, right)
    assert pair.K[0, 0, 0] == pytest.approx(444)
    assert np.linalg.norm(pair.translation) == pytest.approx(1)
    assert pair.valid.mean() > 0.5
    one = tmp_path / "a.jpg"
    from PIL import Image

    photo = Image.fromarray(left)
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 40  # focal length of 35 mm film
    photo.save(one, exif=exif, quality=95)
    write_image(tmp_path / "b.png", right)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        pair = cvkern.reconstruct_pair(one, tmp_path / "b.png", max_keypoints=1500)
    assert len([w for w in told if "image1" in str(w.message)]) == 1
    assert not [w for w in told if "image0" in str(w.message)]
    assert pair.K[0, 0, 0] == pytest.approx(40 / np.hypot(36, 24) * np.hypot(250, 370), rel=0.01)


@pytest.mark.filterwarnings("ignore:the focal length is guessed")
def test_a_camera_that_only_turned_gives_no_depth(motorcycle):
    left = motorcycle[0]
    matrix = K0 @ turned((0.01, -0.06, 0.02)) @ np.linalg.inv(K0)
    seen = cvkern.warp_perspective(left, matrix, left.shape[:2], channel_axis=-1, dtype=np.uint8)
    begin = "image0 and image1 must show a scene with depth from two places: "
    for other, K, end in (
        (seen, K0, "only turned"),
        (seen, None, "only turned, or of a plane"),
        (left, None, "only turned, or of a plane"),
    ):
        with pytest.raises(ValueError, match=begin) as info:
            cvkern.reconstruct_pair(left, other, K, max_keypoints=1500)
        assert str(info.value).endswith(end)


def test_large_photographs_are_reduced(motorcycle):
    left, right, truth = motorcycle
    pair = cvkern.reconstruct_pair(left, right, np.stack((K0, K1)), BASELINE, max_side=200)
    assert pair.depth.shape == (135, 200)
    assert np.nanmedian(pair.depth) == pytest.approx(np.nanmedian(truth), rel=0.1)


def test_refusals(motorcycle):
    left, right, _ = motorcycle
    noise = np.random.default_rng(0).integers(0, 256, left.shape, np.uint8)
    message = r"image0 and image1 must have at least 20 matches of one geometry, got \d+ of \d+"
    with pytest.raises(ValueError, match=message):
        cvkern.reconstruct_pair(left, noise, K0)
    message = "image1 must have shape (H, W), (H, W, 3) or (H, W, 4), got (250,)"
    refused(ValueError, message, cvkern.reconstruct_pair, left, np.zeros(250), K0)
    message = "image0 must be at least 64 x 64 pixels, got (9, 370)"
    refused(ValueError, message, cvkern.reconstruct_pair, left[:9], right, K0)
    refused(ValueError, "baseline must be > 0, got 0", cvkern.reconstruct_pair, left, right, K0, 0)
    # The same photograph nearer: the camera moved forwards.
    zoom = np.array([[1.1, 0, -18.5], [0, 1.1, -12.5], [0, 0, 1]])
    nearer = cvkern.warp_perspective(left, zoom, left.shape[:2], channel_axis=-1, dtype=np.uint8)
    with pytest.raises(ValueError, match="image0 and image1 must"):
        cvkern.reconstruct_pair(left, nearer, K0)


def test_reduced_photographs_keep_their_rays():
    """A pixel's middle (x, y) is at ((x + 1/2) s - 1/2) of a picture s times as wide."""
    camera = np.array([[300.0, 0, 140], [0, 310, 95], [0, 0, 1]])
    small, reduced = _reduced(np.zeros((200, 300), np.uint8), camera, 75)
    assert small.shape == (50, 75)
    np.testing.assert_allclose((reduced @ np.linalg.inv(camera) @ [8, 5, 1])[:2], [1.625, 0.875])


def test_behind_the_second_camera_depths_are_negative():
    for depth, shift in ((3.0, -5.0), (8.0, -5.0), (3.0, 5.0)):
        point, t = np.array([0.3, 0.2, 1]) * depth, np.array([0.4, 0, shift])
        here, there = (q[None] / q[2] for q in (point, point + t))
        (found,) = _depths(here, there, np.eye(3), t)
        assert found == pytest.approx(depth if depth + shift > 0 else -depth)


def test_disparities_reach_beyond_those_of_the_matches():
    rng = np.random.default_rng(1)
    scene = np.repeat(rng.integers(0, 256, (60, 80)), 2, axis=1).astype(np.uint8)
    left, right = scene[:, :120], scene.copy()[:, :120]
    right[:30], right[30:] = scene[:30, 6:126], scene[30:, 14:134]  # to the left by 6 and 14
    disparity, valid = _dense([left, right], np.array([8.0, 12, 9, 11]), np.array([12.0, 8, 11, 9]))
    for rows, want in ((slice(4, 26), 6), (slice(34, 56), 14)):
        part = disparity[rows, 20:100][valid[rows, 20:100]]
        assert len(part) > 1000
        assert np.median(part) == pytest.approx(want, abs=0.5)
