"""Raw frames of two calibrated cameras: a rendered wall whose depth is known."""

from typing import Any

import numpy as np
import pytest
import scipy.ndimage as ndi

import cvkern
from cvkern.geometry.cameras.lens import rays_of, turned
from tests.refusals import refused

SHAPE = 96, 128
LEFT = cvkern.Camera([[110, 0, 66], [0, 110, 45], [0, 0, 1]], [-0.2, 0.05, 1e-3, 0, 0], SHAPE)
RIGHT = cvkern.Camera([[115, 0, 60], [0, 114, 50], [0, 0, 1]], [-0.15], SHAPE)
TURN, SHIFT = turned(np.array([0.01, 0.03, -0.02])), np.array([-0.5, 0.01, 0.02])
NORMAL, AWAY = np.array([0.2, 0.1, 1.0]), 5.0  # a wall: normal . X = AWAY
TEXTURE = ndi.gaussian_filter(np.random.default_rng(0).normal(size=(400, 400)), 1.0)
TEXTURE = (127 + 90 * TEXTURE / np.abs(TEXTURE).max()).clip(0, 255)


def calibration():
    none = np.zeros((0, 3, 3)), np.zeros((0, 3))
    return cvkern.StereoCalibration(LEFT, RIGHT, TURN, SHIFT, 0.0, *none, np.zeros(24))


def seen(camera, turn, shift):
    """Return what a camera sees of the wall."""
    y, x = np.indices(SHAPE)
    rays = rays_of(np.stack((x.ravel(), y.ravel()), axis=1).astype(float), camera) @ turn
    begin = -turn.T @ shift
    along = (AWAY - NORMAL @ begin) / (rays @ NORMAL)
    points = begin + along[:, None] * rays
    places = 200 + 30 * points[:, 1::-1].T
    return ndi.map_coordinates(TEXTURE, places, order=1, mode="wrap").reshape(SHAPE)


def frames(channels=()):
    pair = seen(LEFT, np.eye(3), np.zeros(3)), seen(RIGHT, TURN, SHIFT)
    pair = [image.round().astype(np.uint8) for image in pair]
    return [np.stack([image] * n, axis=2) if (n := sum(channels)) else image for image in pair]


@pytest.mark.parametrize("channels", [(), (3,)])
def test_raw_frames_give_depths(backend, channels):
    options: dict[str, Any] = {"channel_axis": -1} if channels else {}
    with cvkern.StereoMatcher.from_calibration(calibration(), (0, 24), **options) as matcher:
        matcher(*frames(channels))
        found = matcher(*frames(channels))  # by the scratch memory of the first
        rectified = matcher.rectification
    assert rectified is not None
    assert found.depth.shape == SHAPE
    assert found.image.shape == (*SHAPE, *channels)
    y, x = np.indices(SHAPE)
    rays = np.stack((x, y, np.ones(SHAPE)), axis=2) @ np.linalg.inv(rectified.matrix).T
    want = AWAY / (rays @ rectified.rotations[0] @ NORMAL)
    assert found.valid.mean() > 0.7
    share = np.abs(found.depth - want)[found.valid] / want[found.valid]
    # A disparity of 11 is off by a tenth of a pixel or so.
    assert np.median(share) < 0.015
    assert np.quantile(share, 0.95) < 0.06
    pair = rectified(*frames(channels))
    np.testing.assert_array_equal(found.image, pair.left)
    alone = cvkern.stereo_match(*pair, (0, 24), **options)
    np.testing.assert_array_equal(found.disparity, alone.disparity)
    np.testing.assert_array_equal(found.valid, alone.valid)


def test_errors():
    make = cvkern.StereoMatcher.from_calibration
    refused(TypeError, "calibration must be a StereoCalibration, got int", make, 3)
    with pytest.raises(ValueError, match="paths must be one of"):
        make(calibration(), (0, 16), paths=3)
    matcher = make(calibration(), (0, 16))
    refused(
        ValueError, "left must have shape (96, 128), got (96, 127)",
        matcher, np.zeros((96, 127)), np.zeros((96, 127)),
    )  # fmt: skip
