"""Cameras on a GPU: the bits of the CPU, and raw frames as one graph."""

import numpy as np
import pytest

import cvkern
from tests.geometry.boards import View, render
from tests.on_cuda import LIBRARIES, assert_equal_bits, give, on_gpu, reference, take
from tests.stereo.test_calibrated import calibration, frames

pytestmark = pytest.mark.usefixtures("gpu")
CAMERA = cvkern.Camera(
    [[70, 0, 41], [0, 71, 29], [0, 0, 1]], [-0.28, 0.11, 1e-3, -7e-4, -0.03], (60, 80)
)


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_images_without_lenses_are_those_of_the_cpu(backend, dtype, channels):
    image = np.random.default_rng(0).integers(0, 256, (60, 80, *channels)).astype(dtype)

    def call(image):
        return cvkern.undistort(image, CAMERA, rotation=(0.1, -0.1, 0.05))

    assert_equal_bits((on_gpu(call, image, backend),), (reference(call, image),))


@pytest.mark.parametrize("tilt", [0.0, 0.9])
def test_chessboards_are_those_of_the_cpu(backend, tilt):
    view = View(tilt, 0.4, size=(150, 190))
    image = render((4, 5), view)[0].round().clip(0, 255).astype(np.uint8)

    def call(image):
        return cvkern.detect_chessboard(image, (4, 5))

    # Sums of a fit may be fused in another way; it ends within a thousandth of the least squares.
    found = on_gpu(call, image, backend)
    np.testing.assert_allclose(found, reference(call, image), rtol=0, atol=1e-3)


@pytest.mark.parametrize("library", LIBRARIES)
def test_raw_frames_give_depths_in_one_graph(library, backend):
    with cvkern.StereoMatcher.from_calibration(calibration(), (0, 24)) as matcher:
        matcher(*(give(library, image) for image in frames()))
        found = matcher(*(give(library, image) for image in frames()))
    with cvkern.use(backend="warp", device="cpu"):
        want = cvkern.StereoMatcher.from_calibration(calibration(), (0, 24))(*frames())
    assert_equal_bits(tuple(take(a) for a in found), want)


@pytest.mark.parametrize("library", LIBRARIES)
def test_batches_are_those_of_the_cpu(library, backend):
    """Points of several pairs come to the host together, whatever the lengths of their lists."""
    rng = np.random.default_rng(0)
    pairs = []
    for number in (60, 35, 3):
        points = rng.uniform(0, 300, (number, 2)).astype(np.float32)
        pairs.append((points, points + np.float32(7)))
    with cvkern.use(backend="warp", device="cpu"):
        want = cvkern.find_homographies(pairs)
    given = [(give(library, one), give(library, other)) for one, other in pairs]
    with cvkern.use(backend=backend):
        found = cvkern.find_homographies(given)
    np.testing.assert_array_equal(take(found.inliers), want.inliers)
    np.testing.assert_allclose(found.costs, want.costs)
