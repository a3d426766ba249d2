"""What random calls found (``python -m tests.fuzz``), each once: refused, or equal in every bit."""

# pyright: reportArgumentType=false

import re
from typing import Any

import numpy as np
import pytest

import cvkern
import cvkern.clouds
import cvkern.images
from cvkern import radiance
from cvkern._runtime import KERNEL_SETS
from tests.calls import TABLE
from tests.fuzz.families.models import model

SQUARE = np.array([[0.0, 0], [0, 9], [9, 9], [9, 0]])
PAIR = np.arange(18.0).reshape(9, 2)
VIEWS = radiance.cameras(np.eye(4)[None], [50, 50, 8, 6], 17, 13)
BYTES = np.zeros((2, 32), np.uint8)
IMAGE = np.zeros((4, 5))
CAMERA = cvkern.Camera([[40, 0, 31.5], [0, 40, 23.5], [0, 0, 1]], (), (48, 64))
FILM = np.zeros((2, 4, 4, 3), np.uint8)

BUFFER = memoryview(np.eye(3))  # pyright: ignore
COLOURS = np.ones((4, 5, 3))
NONE = np.zeros((0, 3))
SIDE_BY_SIDE = cvkern.StereoCalibration(
    CAMERA, CAMERA, np.eye(3), np.array([-0.2, 0, 0]), 0.0, NONE, NONE, NONE
)
BOARD = cvkern.chessboard_points((3, 4))
TILTED = [cvkern.project_points(BOARD, CAMERA, t, (-1, -1, 6)) for t in ((0.4, 0, 0), (0, 0.4, 0))]
INFINITE = np.where(np.arange(512) == 212, np.inf, np.random.default_rng(20).random(512, "f4"))
UNSEEN = list(np.random.default_rng(0).random((4, 12, 2)) * 60)  # boards behind the camera
POSES = np.stack([np.eye(3)] * 2), np.ones((2, 3))
SURFACE = radiance.Mesh(np.eye(3, dtype="f4"), np.array([[0, 1, 2]]), np.zeros((3, 3), "u1"))
MASKED: Any = np.ma.masked_array([1.0, 2.0], [True, False])
REFUSED = {
    "center": lambda: cvkern.rotate(IMAGE, 3, center=2.0),
    "shape": lambda: cvkern.resize(IMAGE, 0.5),
    "size": lambda: cvkern.rectify_plane(IMAGE, SQUARE, None),
    "corners": lambda: cvkern.rectify_plane(IMAGE, "abc", (3, 3)),
    "matrix": lambda: cvkern.warp_perspective(IMAGE, np.eye(3) * 1j),
    "dtype": lambda: cvkern.remap(IMAGE, np.zeros((2, 1, 1)), dtype=range(3)),
    "antialias": lambda: cvkern.resize(IMAGE, (2, 2), antialias=[]),
    "sigma": lambda: cvkern.corner_harris(IMAGE, sigma=1e300),
    "sigma must be real": lambda: cvkern.retinex(COLOURS, np.datetime64("2020-01-01")),
    "angles must be finite": lambda: cvkern.triangulate_lines(
        np.ones((1, 64)), CAMERA, (0, 0.6, 0.8, -1), angles=-np.inf, pivot=(0, 0, 1)
    ),
    "points0 must be real": lambda: cvkern.fit_affine(PAIR.astype(str), PAIR),
    "points1 must be real": lambda: cvkern.fit_affine(PAIR, [[None, 1.0]] * 9),
    "out": lambda: cvkern.gaussian(IMAGE, out=3.5),
    "axis": lambda: cvkern.sobel(IMAGE, axis=np.zeros(2)),
    "num_peaks": lambda: cvkern.hough_line_peaks(IMAGE, np.arange(5), np.arange(4), num_peaks=[]),
    "mask": lambda: cvkern.images.overlay_mask(BYTES, [1, [2]]),
    "axes": lambda: cvkern.gray_code_patterns((4, 4), axes=0.5),
    "lights": lambda: cvkern.gray_code_patterns((4, 4), lights=[]),
    "phase": lambda: cvkern.unwrap_phase([[1e30, -1e30]]),
    "points0": lambda: cvkern.fit_affine(3.5, PAIR),
    "points1": lambda: cvkern.find_affine(PAIR, None),
    "pairs": lambda: cvkern.find_homographies([PAIR, 3]),
    "pairs[1]": lambda: cvkern.find_homographies([(PAIR, PAIR), (PAIR, 3)]),
    "pairs must": lambda: cvkern.match_images([BYTES, BYTES], [0, 1, 0]),
    "features": lambda: cvkern.match_images(2.0),
    "cross_check": lambda: cvkern.match_descriptors(BYTES, BYTES, cross_check=np.zeros(2)),
    "upright": lambda: cvkern.sift(IMAGE, upright=[]),
    "corners must": lambda: cvkern.corner_subpix(IMAGE, [[np.nan, 1]]),
    "reference": lambda: cvkern.r_table(IMAGE, reference=2 + 0j),
    "scales": lambda: cvkern.generalized_hough(IMAGE, TABLE, scales=2 + 0j),
    "paths": lambda: cvkern.stereo_match(IMAGE, IMAGE, (0, 2), paths=[]),
    "paths must": lambda: cvkern.aggregate_semi_global(BYTES[None], 1, 2, paths=np.zeros(2)),
    "accuracy": lambda: cvkern.hough_ellipse(IMAGE, accuracy=1e-320),
    "fps": lambda: cvkern.clouds.write_animation("a.gif", FILM, fps=1e-320),
    "fps must": lambda: cvkern.clouds.write_animation("a.mp4", FILM, fps=1e-3),
    "baseline must be in": lambda: cvkern.reconstruct_pair(
        np.zeros((64, 64)), np.zeros((64, 64)), np.eye(3), baseline=1e-320
    ),
    r"got 0 to 2$": lambda: cvkern.equalize_adapthist(np.array([[[-0.0, 0.0, 2.0]]])),
    "spans": lambda: radiance.composite_rays(np.ones(2), np.ones((2, 3)), np.ones((2, 2)), 2),
    "xyz": lambda: cvkern.adapt_colors(2, "D65", "D50"),
    "kC": lambda: cvkern.deltaE_ciede2000([[1, 2, 3]], [[1, 2, 3]], kC=[]),
    "dtype must": lambda: cvkern.convert_color([[1, 2, 3]], "rgb", "srgb", dtype=object()),
    "interval": lambda: cvkern.standard_observer(interval=np.zeros(2)),
    "images must": lambda: cvkern.estimate_lights(np.ones((4, 1, 5))),
    "images": lambda: cvkern.estimate_lights(np.zeros((4, 5, 5))),
    "boundary": lambda: cvkern.shape_from_shading(np.ones((1, 5)), [0, 0, 1]),
    "mask must": lambda: cvkern.integrate_normals(np.ones((2, 3, 3)), [[1], [0]]),
    "shape must be": lambda: cvkern.chessboard_points(3),
    "data_range": lambda: cvkern.recognize_panoramas([IMAGE], data_range="a"),
    "images must be": lambda: cvkern.stitch(3.5),
    "length": lambda: cvkern.suggest_line_bins((8, 8), localisation=1e-30, length=1e30),
    "dists": lambda: cvkern.hough_line_peaks(IMAGE, np.arange(5), [0, 1, 2, np.inf]),
    "hspace": lambda: cvkern.hough_line_peaks(IMAGE * np.nan, np.arange(5), np.arange(4)),
    "hspaces": lambda: cvkern.hough_circle_peaks(IMAGE[None] * np.nan, [3]),
    "q": lambda: cvkern.points_from_disparity(IMAGE, [1, [2]]),
    "frames": lambda: cvkern.clouds.write_animation("a.gif", [1, [2]]),
    "path": lambda: cvkern.images.write_image(3.5, IMAGE),
    "name": lambda: cvkern.images.apply_colormap(IMAGE, np.zeros(2)),
    "cameras": lambda: radiance.project(None, 0, PAIR),
    "views": lambda: radiance.orbit_cameras(3),
    "factor": lambda: radiance.orbit_cameras(VIEWS, factor=2.0**31),
    "eyes": lambda: radiance.look_at([], [0, 0, 1]),
    "poses": lambda: radiance.cameras(["x"], [1, 1, 0, 0], 3, 3),
    "model": lambda: radiance.mesh(None),
    "scene": lambda: radiance.fit(None),
    "surface": lambda: radiance.write_mesh("a.ply", None),
    "fixed": lambda: cvkern.calibrate_camera(BOARD, TILTED, (48, 64), fixed=3.5),
    "image_points must": lambda: cvkern.calibrate_camera(BOARD, UNSEEN, (48, 64)),
    "right_points": lambda: cvkern.calibrate_stereo(BOARD, TILTED * 2, UNSEEN, (48, 64)),
    "shape must": lambda: cvkern.chessboard_points(np.array(2)),
    "sigma must": lambda: cvkern.gaussian(IMAGE, np.ma.masked_array([1, 2.0], [True, False])),
    "weights": lambda: cvkern.fit_affine(PAIR, PAIR, np.ma.masked_array(np.ones(9), True)),
    "right must": lambda: cvkern.StereoMatcher((4, 5), (0, 2))(IMAGE.astype("u1"), IMAGE * np.nan),
    "shape must have": lambda: cvkern.StereoMatcher(0),  # pyright: ignore[reportArgumentType]
    "shape must name": lambda: cvkern.Camera(np.eye(3), shape=3),
    "mask must have": lambda: cvkern.estimate_lights(
        np.random.default_rng(0).random((4, 8, 9)), mask=np.indices((8, 9)).sum(0) % 2
    ),
    "object_points": lambda: cvkern.calibrate_camera(3.5, TILTED, (48, 64)),
    "left": lambda: cvkern.calibrate_stereo(
        BOARD,
        TILTED,
        TILTED,
        (48, 64),
        left=0,  # pyright: ignore[reportArgumentType]
    ),
    "values": lambda: cvkern.images.apply_colormap(np.ma.masked_array(IMAGE, IMAGE == 0)),
    "left_points": lambda: cvkern.calibrate_stereo(BOARD, TILTED[:1], TILTED[:1], (48, 64)),
    "right": lambda: cvkern.calibrate_stereo(
        BOARD,
        TILTED,
        [p * 50 for p in TILTED],
        (48, 64),
        right=cvkern.Camera(CAMERA.matrix, [-0.9], (48, 64)),
    ),
    "image_points": lambda: cvkern.calibrate_projector(BOARD, None, [], (48, 64), (9, 9)),
    "image_points[0]": lambda: cvkern.calibrate_projector(
        BOARD, [[[np.nan, 1]]], [None], (48, 64), (9, 9)
    ),
    "decoded": lambda: cvkern.calibrate_projector(BOARD, TILTED, 3.5, (48, 64), (9, 9)),
    "decoded[0]": lambda: cvkern.calibrate_projector(BOARD, [PAIR], [None], (48, 64), (9, 9)),
    "lines": lambda: cvkern.fit_laser_plane(3, CAMERA, *POSES),
    "surface.faces": lambda: radiance.write_mesh("a.ply", SURFACE._replace(faces=[])),
    "surface.faces must": lambda: radiance.write_mesh(
        "a.ply", SURFACE._replace(faces=np.array([[0, 1, 3]]))
    ),
    "surface.points": lambda: radiance.write_mesh("a.ply", SURFACE._replace(points=FILM)),
    "surface.colors": lambda: radiance.write_mesh("a.ply", SURFACE._replace(colors=PAIR[:3])),
    "surface.colors must": lambda: radiance.write_mesh(
        "a.ply", SURFACE._replace(colors=np.zeros((2, 3), "u1"))
    ),
    "views must": lambda: radiance.point_cloud(model(), views=3),
    "truth": lambda: radiance.psnr(IMAGE, IMAGE + np.inf),
    "distances": lambda: radiance.composite_rays(np.ones(2), np.ones((2, 3)), None, [[0, 2]]),
    "image_points must be": lambda: cvkern.calibrate_camera(BOARD, BUFFER, (48, 64)),
    "shape must be rows": lambda: cvkern.calibrate_camera(BOARD, TILTED, BUFFER),
    "shape must be of": lambda: cvkern.detect_chessboard(IMAGE, BUFFER),
    "disparities": lambda: cvkern.stereo_cost(IMAGE, IMAGE, BUFFER),
    "taps": lambda: cvkern.correlate_separable(IMAGE, BUFFER),
    "taps must": lambda: cvkern.correlate_separable(IMAGE, np.array([1 + 1j])),
    "rotation": lambda: cvkern.project_points([[0, 0, 1]], CAMERA, [1e300] * 3),
    "target": lambda: cvkern.adapt_colors([[1, 2, 3]], "D65", [1e300] * 3),
    "illuminant": lambda: cvkern.white_balance(COLOURS, (1e300, 1, 1e-300)),
    "illuminant must": lambda: cvkern.develop(IMAGE, illuminant=(1e300, 1, 1e-300)),
    "seconds": lambda: cvkern.merge_exposures(np.ones((2, 4, 5)), [1, 1e300]),
    "background": lambda: radiance.render(model(), VIEWS, 0, background=2 + 0j),
    "background must": lambda: radiance.render(model(), VIEWS, 0, background=[10**400] * 3),
    "negatives": lambda: cvkern.ShapeModel().fit([IMAGE], negatives=np.ones((2, 2, 2, 2))),
    "albedo": lambda: cvkern.lambertian(IMAGE, [0, 0, 1], albedo=[1, [2]]),
    "albedo must": lambda: cvkern.shape_from_shading(IMAGE, [0, 0, 1], albedo=((1, 2), (3, 4))),
    "lights must": lambda: cvkern.lambertian(IMAGE, [1e300] * 3),
    "light": lambda: cvkern.shape_from_shading(IMAGE, [1e300] * 3),
    "images must not": lambda: cvkern.lights_from_sphere([], IMAGE),
    "images must have": lambda: cvkern.photometric_stereo([IMAGE, IMAGE, IMAGE[1:]], np.eye(3)),
    "right must be": lambda: cvkern.rectify_stereo(SIDE_BY_SIDE)(np.zeros((48, 64)), [1]),
    "radiance": lambda: cvkern.tone_map(np.full((3, 4), 1e38, np.float32)),
    "center must": lambda: cvkern.lateral_inhibition(IMAGE, 2.0**31),
    "image1": lambda: cvkern.reconstruct_pair(
        np.zeros((64, 64), np.uint8), np.zeros((64, 64), np.int64)
    ),
    "channel_axis": lambda: cvkern.box(COLOURS, channel_axis=np.ma.masked_array(2, True)),  # type: ignore
    "channel_axis must": lambda: cvkern.images.luma(IMAGE, channel_axis=MASKED),
    "use_quantiles": lambda: cvkern.canny(IMAGE, use_quantiles=MASKED),
    "high_threshold": lambda: cvkern.r_table(IMAGE, orientation=IMAGE, high_threshold=MASKED),
    "cval": lambda: cvkern.pyramid_gaussian(IMAGE, 0, mode="wrap", cval=MASKED),
    "neighborhood": lambda: cvkern.stereo_cost(
        IMAGE, IMAGE, (0, 2), cost="zncc", neighborhood=MASKED
    ),
    "spindle": lambda: cvkern.triangulate_lines(IMAGE, CAMERA, (0, 0, 1, 1), spindle=MASKED),
    "focal_lengths": lambda: cvkern.reconstruct([COLOURS, COLOURS], focal_lengths=1e-320),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_name_their_argument(name):
    with pytest.raises((ValueError, TypeError), match=rf"(^|\W){re.escape(name.split()[0])}(\W|$)"):
        REFUSED[name]()


@pytest.mark.parametrize(
    "call",
    [
        lambda: cvkern.epipolar_lines(np.eye(3), [[1e200, 1e300], [np.inf, 0]]),
        lambda: cvkern.sampson_distance(np.eye(3), PAIR * 1e200, PAIR),
        lambda: cvkern.find_similarity([[0.0, 0]] * 3, [[0.0, 0]] * 3, threshold=1e-38),
        lambda: radiance.project(VIEWS, False, np.full((1, 3), np.inf)),
        lambda: radiance.pixel_rays(VIEWS, 0, [[np.inf, 0]]),
        lambda: radiance.psnr([[1e-30]], [[0.0]]),
        lambda: cvkern.project_points([[np.inf, 0, 1]], CAMERA),
        lambda: cvkern.develop(np.full((6, 8), np.inf, "f4"), illuminant=(1, 1, 1)),
        lambda: cvkern.fuse_exposures(np.full((2, 6, 8), 1e30, "f4")),
        lambda: cvkern.integrate_normals(np.ones((2, 2, 3)), [[1, 1], [1, 0]]),
        lambda: cvkern.images.luma(np.array([[[np.inf, -np.inf, 0]]], "f4")),
        lambda: cvkern.images.apply_colormap([[0, 14]], vmax=1e-320),
        lambda: cvkern.remap_backward([[1.0]], IMAGE, np.ones((2, 1, 1)), np.int64(3)),
        lambda: cvkern.find_similarity(PAIR, PAIR, threshold=1e30),
        lambda: cvkern.retinex(COLOURS, method="gradients", threshold=1e30),
        lambda: radiance.ssim(np.zeros((16, 16)), np.ones((16, 16)), data_range=1e-320),
        lambda: cvkern.estimate_illuminant(COLOURS * np.arange(-2, 3)[:, None], black=0.5),
        lambda: cvkern.equalize_adapthist(IMAGE, clip_limit=1e30),
        lambda: cvkern.lateral_inhibition(IMAGE + np.eye(4, 5), weight=3e38),
        lambda: cvkern.images.luma(np.full((4, 5), 1e300)),
        lambda: cvkern.make_scan("laser", (1, 1), (1, 1), frames=1, noise=-0.0),
        lambda: cvkern.detect_chessboard(INFINITE.reshape(8, 64), (3, 3)),
        lambda: cvkern.triangulate_lines(
            np.ones((1, 64)),
            CAMERA,
            (0, 0.6, 0.8, -1),
            angles=[1],
            pivot=(0, 0, 1),
            spindle=(0, 1e300, 1e300),
        ),
        lambda: cvkern.hough_line_peaks(
            np.array([[np.inf, np.inf, 0]], "f4"), np.arange(3), [0], threshold=9, refine=True
        ),
        lambda: cvkern.shape_from_shading(
            np.full((1, 2), 0.9), (0, 0, 1), boundary=[[[np.inf] * 3, [0, 1e300, 1e300]]]
        ),
        lambda: cvkern.subpixel_edges(np.array([[0, 3e38, -3e38, 1e30, 5]] * 5, "f4"), 0.6, 1, 2),
    ],
)
def test_nothing_is_raised_or_warned_of(call):
    call()


@pytest.mark.parametrize("marked", [0.5, 256, -1, 1e-60])
def test_a_mask_is_set_where_it_is_not_0(marked):
    """A cast to bytes made 0 of such values; a cast to float32, of the least."""
    scan = cvkern.make_scan("gray_code", (12, 16), (12, 16), seed=1).calibration
    spots = np.zeros((12, 16))
    spots[::2] = 1
    columns, photo = np.full((12, 16), 7.0), np.random.default_rng(0).random((12, 16))
    calls = [
        lambda mask: cvkern.triangulate_columns(columns, scan, mask),
        lambda mask: cvkern.unwrap_phase(photo, mask),
        lambda mask: cvkern.hough_line(mask)[0],
        lambda mask: cvkern.canny(photo, 1, mask=mask),
        lambda mask: cvkern.integrate_normals(np.full((12, 16, 3), [0.1, 0.2, 1]), mask),
        lambda mask: cvkern.estimate_illuminant(np.dstack([photo] * 3), mask=mask),
    ]
    for call in calls:
        np.testing.assert_array_equal(call(spots * marked), call(spots > 0))


def spoilt(*shape, seed=0, share=0.2, kinds=(np.nan, np.inf, -np.inf, -0.0)):
    """Return noise with values that are not finite in it."""
    rng = np.random.default_rng(seed)
    values = rng.random(shape).astype(np.float32)
    where = rng.random(shape) < share
    values[where] = rng.choice(kinds, where.sum())
    return values


FRINGES = cvkern.phase_shift_patterns((16, 31)).astype(np.float32)


def holes(seed):
    """Return values for the frames, some of them not finite."""
    return spoilt(*FRINGES.shape, seed=seed, share=0.02)


EQUAL = {
    "winner_take_all": lambda s: cvkern.winner_take_all(spoilt(9, 17, 33, seed=s)),
    "winner_take_all of zeros": lambda s: cvkern.winner_take_all(
        spoilt(3, 5, 33, seed=s, share=1, kinds=(0.0, -0.0, -np.inf, np.nan))
    ),
    "sift": lambda s: cvkern.sift(spoilt(48, 70, seed=s, share=0.01)),
    "sift of large values": lambda s: cvkern.sift(spoilt(48, 70, seed=s) * np.float32(1e30)),
    "decode_phase_shift": lambda s: cvkern.decode_phase_shift(
        np.where(np.isfinite(holes(s)), FRINGES, holes(s)), (16, 31)
    )[:3],
    "resize": lambda s: cvkern.resize(spoilt(9, 7, seed=s), (5, 8), dtype="uint8"),
    "remap of zeros": lambda s: cvkern.warp_perspective([[-0.0]], np.eye(3), (3, 3), mode="mirror"),
    "median": lambda s: cvkern.median(spoilt(9, 9, seed=s), 1),
    "gradient whose orientation is -0.0": lambda s: cvkern.gradient(
        np.array([[0, 3.4e38], [0, 3.3e38], [0, 3.2e38]], "f4"), sigma=0, operator="sobel"
    ),
    "gradient": lambda s: cvkern.gradient(spoilt(9, 9, seed=s, share=0.05)),
    "detect_laser_lines of a flat frame": lambda s: cvkern.detect_laser_lines(
        np.full((2, 40, 8), 9.5e-6 / 3**s, np.float32), sigma=1.7762824562096369, threshold=0
    ),
    "guided_median": lambda s: cvkern.guided_median(
        spoilt(9, 9, seed=s, kinds=(np.nan, 0.0, -0.0)), np.zeros((9, 9), np.uint8), 2
    ),
}


@pytest.mark.parametrize("name", EQUAL)
def test_values_that_are_not_finite_give_equal_bits(name):
    for seed in range(3):
        answers = []
        for backend in KERNEL_SETS:
            with cvkern.use(backend=backend):
                got = EQUAL[name](seed)
            answers.append(got if isinstance(got, tuple) else (got,))
        for a, b in zip(*answers, strict=True):
            np.testing.assert_array_equal(a, b)
            if a.dtype.kind == "f":
                np.testing.assert_array_equal(np.signbit(a[a == 0]), np.signbit(b[b == 0]))


def test_nan_is_an_infinite_cost():
    costs = np.array([[[np.nan, 5, 1, np.nan, 9], [np.nan, np.nan, np.nan, np.nan, np.nan]]], "f4")
    winner = cvkern.winner_take_all(costs)
    np.testing.assert_array_equal(winner.disparity, [[2, 0]])  # no fit beside an infinite cost
    np.testing.assert_array_equal(winner.cost, [[1, np.inf]])
    np.testing.assert_allclose(winner.confidence, [[1 - 1 / 9, 0]], rtol=1e-6)


def test_a_byte_holds_0_for_nan(backend):
    found = cvkern.remap([[np.nan, np.inf, -np.inf, 254.5]], [[[0] * 4], [[0, 1, 2, 3]]], 0,
                         dtype="uint8")  # fmt: skip
    assert found.tolist() == [[0, 255, 0, 255]]


def test_keypoints_do_not_see_what_is_not_finite(backend):
    image = np.random.default_rng(3).random((48, 70)).astype(np.float32)
    holes = image.copy()
    holes[20:22, 30] = np.nan, -np.inf
    image[20:22, 30] = 0
    for a, b in zip(cvkern.sift(image), cvkern.sift(holes), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_place_one_of_whose_frames_is_nan_is_not_valid(backend):
    frames = FRINGES.copy()
    frames[5, 3, 4] = np.nan
    found = cvkern.decode_phase_shift(frames, (16, 31))
    assert not found.valid[3, 4]
    assert np.isnan(found.columns[3, 4])
    assert found.valid.sum() == found.valid.size - 1


def test_options_of_another_length_are_named():
    camera = cvkern.Camera([[4, 0, 1], [0, 4, 1], [0, 0, 1]], shape=(3, 3))
    with pytest.raises(TypeError, match="shape must be rows and columns, got 1"):
        cvkern.undistort(np.zeros((3, 3)), camera, shape=1)  # pyright: ignore[reportArgumentType]
    given = np.ones((1, 3)), camera, (0, 0.6, 0.8, -1.0)
    for spindle in ((1, 2), (0, 0, 0), (0, np.nan, 1)):
        with pytest.raises(ValueError, match="spindle must be "):
            cvkern.triangulate_lines(*given, angles=(0,), pivot=(0, 0, 1), spindle=spindle)
