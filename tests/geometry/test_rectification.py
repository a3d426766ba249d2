"""Images without lenses, and pairs whose rows meet: NumPy, OpenCV, rendered truth."""

import cv2
import numpy as np
import pytest

import cvkern
from cvkern.geometry.cameras.lens import turned
from cvkern.geometry.cameras.undistortion import undistortion_numbers
from cvkern.images import read_image
from cvkern.kernels.codes.geometry import LENS_SEGMENT
from tests.geometry.test_calibration import LEFT, RIGHT, SHIFT, TURN
from tests.refusals import refused
from tests.truth import truth

F32, U8 = np.float32, np.uint8
HALVES = 0, LENS_SEGMENT // 2, LENS_SEGMENT
SIDES = 60, 80
LENS = [-0.28, 0.11, 1.3e-3, -7e-4, -0.03]
CAMERA = cvkern.Camera([[70, 0, 41], [0, 71, 29], [0, 0, 1]], LENS, SIDES)
AHEAD = np.array([[55.0, 0, 38], [0, 54, 31], [0, 0, 1]])
AXIS = np.array([0.1, -0.15, 0.05])


def picture(*channels, dtype=U8):
    """Return waves of several pixels, so that rounding of places shows little."""
    y, x = np.indices(SIDES)
    waves = [127 + 60 * np.sin(x / 4 + c) + 60 * np.cos(y / 5 - c) for c in range(sum(channels, 1))]
    image = np.stack(waves, axis=2)[..., : max(1, *channels, 1)]
    return image.reshape(*SIDES, *channels).astype(dtype)


def places(numbers, i, j):
    """Return where pixels are seen, column and row, and whether they are."""
    m, (fx, fy, cx, cy, k1, k2, p1, p2, k3), widest = numbers[:9], numbers[9:18], numbers[18]
    z = m[6] * j + (m[7] * i + m[8])
    w = F32(1) / z
    x = (m[0] * j + (m[1] * i + m[2])) * w
    y = (m[3] * j + (m[4] * i + m[5])) * w
    xx, yy, xy = x * x, y * y, x * y
    r2 = xx + yy
    radial = F32(1) + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = fx * (x * radial + (2 * (p1 * xy) + p2 * (r2 + 2 * xx))) + cx
    v = fy * (y * radial + (p1 * (r2 + 2 * yy) + 2 * (p2 * xy))) + cy
    return u, v, (z > 0) & (r2 < widest)


def sampled(src, numbers, shape, cval):
    """Sample as the kernels say that they do, in float32 and in the order of their sums."""
    i, j = (a.astype(F32) for a in np.indices(shape))
    u, v, seen = places(numbers, i, j)
    if numbers[19]:
        t = j % F32(LENS_SEGMENT)
        ends = [places(numbers, i, j - t + F32(step)) for step in HALVES]
        both = ends[0][2] & ends[2][2]
        for n, exact in enumerate((u, v)):
            p0, p1, p2 = (end[n] for end in ends)
            one, two = p1 - p0, p2 - p1
            a, b = (
                (F32(3) * one - two) * F32(1 / LENS_SEGMENT),
                (two - one) * F32(2 / LENS_SEGMENT**2),
            )
            exact[both] = (p0 + t * (a + t * b))[both]
        seen |= both
    height, width = src.shape[:2]
    seen &= (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
    u, v = np.where(seen, u, 0), np.where(seen, v, 0)
    if src.dtype == U8:
        ix, iy = (np.int32(a * F32(256) + F32(0.5)) for a in (u, v))
        x0, y0 = np.minimum(ix >> 8, width - 2), np.minimum(iy >> 8, height - 2)
        wx, wy = (ix - (x0 << 8))[..., None], (iy - (y0 << 8))[..., None]
        a, b, c, d = (src[y0 + k, x0 + n].astype(np.int32) for k in (0, 1) for n in (0, 1))
        top, low = (a << 8) + wx * (b - a), (c << 8) + wx * (d - c)
        values = ((top << 8) + wy * (low - top) + 32768) >> 16
    else:
        x0, y0 = np.minimum(np.int32(u), width - 2), np.minimum(np.int32(v), height - 2)
        wx, wy = (u - F32(x0))[..., None], (v - F32(y0))[..., None]
        a, b, c, d = (src[y0 + k, x0 + n] for k in (0, 1) for n in (0, 1))
        top, low = a + wx * (b - a), c + wx * (d - c)
        values = top + wy * (low - top)
    return np.where(seen[..., None], values, cval).astype(src.dtype)


@pytest.mark.parametrize("scalar", [U8, F32])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("parabolas", [False, True])
def test_samples_are_numpys_in_every_bit(kernels, scalar, channels, parabolas):
    src = np.random.default_rng(0).integers(0, 256, (*SIDES, channels)).astype(scalar)
    # More than one part of 256 columns; on CUDA rows of whole words, and of no whole words.
    shape = 50, 304 if parabolas else 301
    stretched = AHEAD * [[4], [1], [1]]
    numbers = undistortion_numbers(CAMERA, stretched, AXIS, shape).copy()
    numbers[19] = parabolas
    found = kernels(
        "geometry.cameras.undistortion.sample",
        src,
        numbers,
        7.0,
        out=[((*shape, channels), scalar)],
    )
    want = sampled(src, numbers, shape, 7)
    assert 0.1 < (want == 7).all(axis=2).mean() < 0.9
    np.testing.assert_array_equal(found, want)


def test_a_camera_whose_images_have_an_unknown_shape():
    image = np.random.default_rng(0).integers(0, 256, SIDES).astype(U8)
    told = cvkern.undistort(image, CAMERA)
    found = cvkern.undistort(image, cvkern.Camera(CAMERA.matrix, CAMERA.distortion))
    np.testing.assert_array_equal(found, told)


@pytest.mark.parametrize("dtype", [U8, F32])
def test_without_a_lens_every_pixel_stays(backend, dtype):
    """Those of the last row and the last column, too: places are exact."""
    image = np.random.default_rng(0).integers(1, 256, (33, 65)).astype(dtype)
    camera = cvkern.Camera([[64, 0, 32], [0, 64, 16], [0, 0, 1]], [0] * 5, (33, 65))
    np.testing.assert_array_equal(cvkern.undistort(image, camera, camera.matrix), image)


@pytest.mark.parametrize("channels", [(), (3,)])
def test_images_are_those_of_opencv(backend, channels):
    image = picture(*channels)
    found = cvkern.undistort(image, CAMERA, AHEAD, AXIS)
    maps = cv2.initUndistortRectifyMap(
        CAMERA.matrix, CAMERA.distortion, turned(AXIS), AHEAD, SIDES[::-1], cv2.CV_32FC1
    )
    want = cv2.remap(image, *maps, cv2.INTER_LINEAR)
    inside = (maps[0] > 0) & (maps[0] < SIDES[1] - 1) & (maps[1] > 0) & (maps[1] < SIDES[0] - 1)
    assert found.dtype == U8
    assert found.shape == image.shape
    # Slopes of 27 a pixel; OpenCV rounds places to 1/32 pixel, this to 1/256.
    assert np.abs(found[inside].astype(int) - want[inside]).max() <= 1
    exact = cvkern.undistort(image.astype(float), CAMERA, AHEAD, AXIS)
    assert exact.dtype == F32
    assert np.abs(exact - found).max() <= 0.5 + 27 / 256


@pytest.mark.parametrize("zoom", [1, 6, 12, 24])
@pytest.mark.parametrize("axis", [(0, 0, 0), (0.1, -0.15, 0.3)])
def test_parabolas_replace_the_lens_where_they_are_good(zoom, axis):
    """At small sizes a lens bends too much within 32 pixels; at large ones it does not."""
    shape = SIDES[0] * zoom, SIDES[1] * zoom
    matrix = CAMERA.matrix * [[zoom], [zoom], [1]]
    camera = cvkern.Camera(matrix, LENS, shape)
    numbers = undistortion_numbers(camera, None, axis, shape)
    i, j = (a.astype(F32)[::zoom] for a in np.indices(shape))
    u, v, seen = places(numbers, i, j)
    t = j % F32(LENS_SEGMENT)
    ends = [places(numbers, i, j - t + F32(step)) for step in HALVES]
    used = ends[0][2] & ends[2][2] & seen
    s = t / LENS_SEGMENT
    shares = [(2 * s - 1) * (s - 1), 4 * s * (1 - s), s * (2 * s - 1)]
    off = max(
        np.abs(sum(share * end[n] for share, end in zip(shares, ends, strict=True)) - right)[
            used
        ].max()
        for n, right in enumerate((u, v))
    )
    # Columns up to 1920 are rounded by 6e-5, some times.
    assert off < 1.2 / 512 if numbers[19] else off > 0.8 / 512
    assert zoom not in (1, 24) or numbers[19] == (zoom == 24)


def test_a_straight_line_is_straight_again():
    ahead = cvkern.Camera(AHEAD, shape=SIDES)
    points = np.stack((np.full(30, 0.2), np.linspace(-0.4, 0.4, 30)), axis=1)
    rays = np.column_stack((points[:, ::-1], np.ones(30)))
    image = np.zeros(SIDES)
    for y, x in cvkern.project_points(rays, CAMERA).round().astype(int):
        image[y, x] = 1
    found = cvkern.undistort(image, CAMERA, AHEAD)
    row, column = np.nonzero(found > 0.25)
    want = cvkern.project_points(rays, ahead)
    assert np.abs(row - want[0, 0]).max() < 1.3
    assert np.abs(column.min() - want[0, 1]) < 2


def test_what_the_camera_did_not_see():
    image = np.full(SIDES, 9.0)
    far = [[4.0, 0, 40], [0, 4, 30], [0, 0, 1]]
    found = cvkern.undistort(image, CAMERA, far, cval=-1, shape=(70, 90))
    assert found.shape == (70, 90)
    assert found[30, 40] == 9
    assert (found[:5] == -1).all()
    behind = cvkern.undistort(image, CAMERA, rotation=(0, np.pi, 0), cval=-1)
    assert (behind == -1).all()
    assert (cvkern.undistort(image.astype(U8), CAMERA, far, cval=300)[:5] == 255).all()
    # Beyond the fold of a lens, r (1 - r^2 / 3), the polynomial would come back into the image.
    fold = cvkern.Camera([[30, 0, 40], [0, 30, 30], [0, 0, 1]], [-1 / 3], SIDES)
    wide = cvkern.undistort(image, fold, [[10, 0, 40], [0, 10, 30], [0, 0, 1]], cval=-1)
    radius = np.hypot(*(np.indices(SIDES) - np.array([30, 40])[:, None, None])) / 10
    assert (wide[radius > 1.01] == -1).all()
    assert (wide[radius < 0.99] == 9).all()


# --- pairs ---------------------------------------------------------------------------------------


def pair(left=LEFT, right=RIGHT, turn=TURN, shift=SHIFT):
    none = np.zeros((0, 3, 3)), np.zeros((0, 3))
    return cvkern.StereoCalibration(left, right, turn, shift, 0.0, *none, np.zeros(24))


@pytest.mark.parametrize("keep", ["scale", "valid", "all"])
def test_rows_meet_and_disparities_tell_depths(keep):
    scene = np.random.default_rng(0).uniform((-150, -100, 500), (200, 100, 900), (300, 3))
    left = cvkern.project_points(scene, LEFT)
    right = cvkern.project_points(scene, RIGHT, TURN, SHIFT)
    found = cvkern.rectify_stereo(pair(), keep=keep)
    one, other = found.points(left, right)
    np.testing.assert_allclose(one[:, 0], other[:, 0], rtol=0, atol=1e-6)
    disparity = one[:, 1] - other[:, 1]
    depth = (scene @ found.rotations[0].T)[:, 2]
    np.testing.assert_allclose(found.focal * found.baseline / disparity, depth, rtol=1e-8)
    homogeneous = np.column_stack((one[:, ::-1], disparity, np.ones(300))) @ found.reprojection.T
    space = homogeneous[:, :3] / homogeneous[:, 3:]
    np.testing.assert_allclose(space, scene @ found.rotations[0].T, rtol=0, atol=1e-5)
    want = cvkern.reprojection_matrix(found.focal, found.baseline, *found.matrix[:2, 2])
    np.testing.assert_allclose(found.reprojection, want, rtol=1e-12)


def test_turns_are_those_of_opencv():
    found = cvkern.rectify_stereo(pair())
    want = cv2.stereoRectify(
        LEFT.matrix, LEFT.distortion, RIGHT.matrix, RIGHT.distortion, LEFT.shape[::-1], TURN,
        SHIFT[:, None], alpha=-1,
    )  # fmt: skip
    for mine, other in zip(found.rotations, want[:2], strict=True):
        np.testing.assert_allclose(mine, other, rtol=0, atol=1e-9)


def test_what_is_kept():
    white = np.full(LEFT.shape, 200, U8)
    share = {}
    for keep in ("all", "scale", "valid"):
        found = cvkern.rectify_stereo(pair(), keep=keep)
        share[keep] = [np.mean(image == 200) for image in found(white, white)]
    assert min(share["valid"]) > 0.9999
    assert max(share["all"]) < 0.97
    height, width = LEFT.shape
    share = np.linspace(0, 1, 20)
    ends = [(a, b) for a in (0, 1) for b in share] + [(b, a) for a in (0, 1) for b in share]
    frame = np.array(ends) * (height - 1, width - 1)
    places = np.concatenate(cvkern.rectify_stereo(pair(), keep="all").points(frame, frame))
    assert (places.min(axis=0) > -0.5).all()  # cut nowhere,
    assert (places.max(axis=0) < (height - 0.5, width - 0.5)).all()
    assert ((np.ptp(places, axis=0) + 2) / LEFT.shape).max() > 1  # and no smaller than need be
    half = cvkern.rectify_stereo(pair(), zoom=0.5)
    assert half.focal == pytest.approx(cvkern.rectify_stereo(pair()).focal / 2)


def test_photographs():
    """13 pairs; OpenCV's corners and calibration have 0.127 px, and 0.136 on an unseen half."""
    folder = truth("two_view") / "chessboard_stereo"
    numbers = [path.stem[4:] for path in sorted(folder.glob("left[0-9]*.jpg"))]
    left, right = (
        [cvkern.detect_chessboard(read_image(folder / f"{side}{n}.jpg"), (6, 9)) for n in numbers]
        for side in ("left", "right")
    )
    board = cvkern.chessboard_points((6, 9))

    def gaps(known, tried):
        calibration = cvkern.calibrate_stereo(
            board, [left[n] for n in known], [right[n] for n in known], (480, 640)
        )
        rectified = cvkern.rectify_stereo(calibration)
        pairs = [rectified.points(left[n], right[n]) for n in tried]
        return np.mean([np.abs(a[:, 0] - b[:, 0]).mean() for a, b in pairs])

    assert gaps(range(13), range(13)) < 0.08
    assert gaps(range(0, 13, 2), range(1, 13, 2)) < 0.1


# --- errors --------------------------------------------------------------------------------------


def test_errors(no_kernel_runs):
    image = np.zeros(SIDES)
    for said, *arguments, options in (
        ("image must have the shape of the camera, (60, 80), got (60, 81)",
         np.zeros((60, 81)), CAMERA, {}),
        ("image must have at most 4 channels, got 5", np.zeros((*SIDES, 5)), CAMERA, {}),
        ("image must have at least 2 rows and 2 columns, got shape (1, 80)",
         np.zeros((1, 80)), cvkern.Camera(np.eye(3), (), (1, 80)), {}),
        ("matrix must have an inverse, got a matrix of rank below 3",
         image, CAMERA, np.zeros((3, 3)), {}),
        ("shape must be rows and columns, got 3 numbers", image, CAMERA, {"shape": (1, 2, 3)}),
        ("cval must be finite, got nan", image, CAMERA, {"cval": np.nan}),
    ):  # fmt: skip
        refused(ValueError, said, cvkern.undistort, *arguments, **options)
    refused(TypeError, "camera must be a Camera, got int", cvkern.undistort, image, 3)


def test_errors_of_pairs():
    refused(TypeError, "calibration must be a StereoCalibration, got int", cvkern.rectify_stereo, 3)
    refused(
        ValueError, "keep must be one of ('scale', 'valid', 'all'), got 'most'",
        cvkern.rectify_stereo, pair(), keep="most",
    )  # fmt: skip
    refused(ValueError, "zoom must be > 0, got 0", cvkern.rectify_stereo, pair(), zoom=0)
    for shift in ((90, 0, 0), (0, -90, 0), (0, 0, -90)):
        with pytest.raises(ValueError, match="second camera to the right of the first"):
            cvkern.rectify_stereo(pair(turn=np.eye(3), shift=np.array(shift, float)))
