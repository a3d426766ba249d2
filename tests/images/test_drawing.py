"""Grey values, colour maps, and drawing."""

import cv2
import numpy as np
import pytest
import skimage.color

from cvkern import images

GRAY = np.zeros((4, 5), np.uint8)


def noise(dtype, shape=(13, 17), seed=0):
    rng = np.random.default_rng(seed)
    if np.dtype(dtype).kind == "f":
        return rng.standard_normal(shape).astype(dtype)
    return rng.integers(0, np.iinfo(dtype).max + 1, shape, dtype=dtype)


# Grey and colour


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32", "float64"])
def test_luma_is_that_of_skimage(dtype):
    image = noise(dtype, (9, 11, 4))
    gray = images.luma(image)
    assert gray.dtype == np.float32
    expected = skimage.color.rgb2gray(image[..., :3].astype(np.float64))
    np.testing.assert_allclose(gray, expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(images.luma(np.moveaxis(image, -1, 0), channel_axis=0), gray)


def test_luma_of_gray_and_of_nonsense():
    gray = noise("uint16")
    assert np.array_equal(images.luma(gray), gray)
    assert images.luma(gray).dtype == np.float32
    for shape in ((5,), (4, 5, 2), (4, 5, 3, 3)):
        with pytest.raises(ValueError, match="image must"):
            images.luma(np.ones(shape))
    with pytest.raises(ValueError, match="channel_axis 3"):
        images.luma(np.ones((4, 5, 3)), channel_axis=3)


def oklab_lightness(colors):
    """Return the lightness of sRGB colours in OKLab."""
    c = colors / 255.0
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    m = [[0.4122214708, 0.5363325363, 0.0514459929], [0.2119034982, 0.6806995451, 0.1073969566]]
    m += [[0.0883024619, 0.2817188376, 0.6299787005]]
    return np.cbrt(linear @ np.array(m).T) @ [0.2104542553, 0.7936177850, -0.0040720468]


def test_colormaps_keep_their_promises():
    ramp = np.linspace(0, 1, 256)[None]
    shades = {
        name: images.apply_colormap(ramp, name, vmin=0, vmax=1)[0] for name in images.COLORMAPS
    }
    assert np.array_equal(shades["gray"], np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, 1))
    steps = np.diff(oklab_lightness(shades["sequential"]))
    assert (steps > 0).all()
    light = oklab_lightness(shades["diverging"])
    assert np.abs(light - light[::-1]).max() < 0.02
    assert (np.diff(light[:128]) > 0).all()
    assert np.ptp(oklab_lightness(shades["cyclic"])) < 0.01
    jump = np.abs(shades["cyclic"][0].astype(int) - shades["cyclic"][-1]).max()
    assert jump <= 6  # it closes


def test_colormap_range():
    values = np.array([[-np.inf, -1, 0, 1, np.inf, np.nan]])
    shown = images.apply_colormap(values, "gray")[0]
    assert shown[:, 0].tolist() == [0, 0, 128, 255, 255, 255]
    assert shown[5].tolist() == [255, 0, 255]
    assert images.apply_colormap(values, "gray", nan=(1, 2, 3))[0, 5].tolist() == [1, 2, 3]
    assert (images.apply_colormap(np.full((2, 2), 7), "gray") == 0).all()
    assert (images.apply_colormap(np.full((2, 2), np.nan)) == (255, 0, 255)).all()
    angles = np.array([[-3.0, 0.1, 2.0]])
    turned = images.apply_colormap(angles + 2 * np.pi, "cyclic")
    assert np.abs(images.apply_colormap(angles, "cyclic").astype(int) - turned).max() <= 1


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        ({"values": np.ones(3)}, "2-D"),
        ({"values": np.ones((0, 3))}, "empty"),
        ({"values": np.ones((2, 3)), "name": "jet"}, "name must be one of"),
        ({"values": np.ones((2, 3)), "vmin": 2, "vmax": 1}, "vmin must"),
        ({"values": np.ones((2, 3)), "vmax": np.inf}, "vmax must"),
        ({"values": np.ones((2, 3)), "nan": (1, 2)}, "nan must"),
    ],
)
def test_colormap_errors(arguments, rule):
    with pytest.raises(ValueError, match=rule):
        images.apply_colormap(**arguments)


# Overlays

WHITE = (255, 255, 255)


def drawn(draw, shapes, size=(24, 28), **options):
    """Return the coverage of shapes on black, in [0, 1]."""
    return draw(np.zeros(size, np.uint8), shapes, color=WHITE, **options)[..., 0] / 255.0


def centroid(cover):
    y, x = np.indices(cover.shape)
    return np.array([(cover * y).sum(), (cover * x).sum()]) / cover.sum()


@pytest.mark.parametrize("radius", [1.5, 2.0, 3.3])
def test_points_lie_where_they_should(radius):
    for place in np.random.default_rng(2).random((25, 2)) + 11:
        cover = drawn(images.draw_points, [place], radius=radius)
        assert np.abs(centroid(cover) - place).max() < 0.02
        assert cover.sum() == pytest.approx(np.pi * radius**2, rel=0.01)


@pytest.mark.parametrize("width", [0.2, 1.0, 1.5, 4.0])
def test_lines_lie_where_they_should(width):
    rng = np.random.default_rng(3)
    for _ in range(12):
        middle, angle = rng.random(2) + 30, rng.random() * np.pi
        along = 20 * np.array([np.sin(angle), np.cos(angle)])
        cover = drawn(
            images.draw_lines, [[*(middle - along), *(middle + along)]], (62, 62), width=width
        )
        area = 40 * width + np.pi * width**2 / 4
        # Thin lines are faint, and a byte holds no less than 1/255 of a pixel.
        assert cover.sum() == pytest.approx(area, rel=0.04 if width < 1 else 0.01)
        # Covered area shifts the centroid along an axis where the width is no whole number: by
        # 0.07 pixels for 1.5, by up to 0.5 for a line thinner than a pixel.
        off = np.dot(centroid(cover) - middle, [along[1], -along[0]]) / 20
        assert abs(off) < (0.5 if width < 1 else 0.08 if width % 1 else 0.03)


def test_epipolar_lines_lie_where_they_should():
    """Each is drawn as the segment between where OpenCV's line meets the borders."""
    matrix = np.array([[0.0, -1e-4, 0.01], [2e-4, 0, -0.02], [-0.02, 0.015, 1]])
    points = np.array([[10.0, 20], [35, 40], [60, 5]])
    image = np.zeros((50, 70))
    for side in (0, 1):
        found = images.draw_epipolar_lines(image, matrix, points, side=side)
        lines = cv2.computeCorrespondEpilines(points[:, None, ::-1].copy(), side + 1, matrix)[:, 0]
        ends = []
        for a, b, c in lines:
            left, right = -5.0, 75.0
            ends.append((-(c + a * left) / b, left, -(c + a * right) / b, right))
        right = images.draw_lines(image, ends)
        assert right.any()
        assert np.abs(found.astype(int) - right).max() <= 16  # samples of a pixel's cover
    nothing = images.draw_epipolar_lines(image, [[0, 0, 0], [0, 0, -1], [0, 1, 0]], [[90, 5]])
    assert not nothing.any()
    with pytest.raises(ValueError, match="side must be in"):
        images.draw_epipolar_lines(image, matrix, points, side=2)


def test_circles_lie_where_they_should():
    rng = np.random.default_rng(4)
    for radius in (0.0, 0.4, 3.3, 17.0):
        middle = rng.random(2) + 24
        cover = drawn(images.draw_circles, [[*middle, radius]], (50, 51), width=2.0)
        assert np.abs(centroid(cover) - middle).max() < 0.05
        area = np.pi * ((radius + 1) ** 2 - max(radius - 1, 0) ** 2)
        assert cover.sum() == pytest.approx(area, rel=0.02)


def test_coverage_is_that_of_fine_sampling():
    size, fine = (20, 22), 32
    place = (np.arange(20 * fine) + 0.5) / fine - 0.5
    y, x = place[:, None], ((np.arange(22 * fine) + 0.5) / fine - 0.5)[None]

    def averaged(inside):
        return inside.reshape(size[0], fine, size[1], fine).mean(axis=(1, 3))

    disc = np.hypot(y - 9.3, x - 8.8) <= 4.2
    assert (
        np.abs(drawn(images.draw_points, [[9.3, 8.8]], size, radius=4.2) - averaged(disc)).max()
        < 0.03
    )
    t = np.clip(((y - 3.2) * 11 + (x - 2.1) * 14.5) / (11**2 + 14.5**2), 0, 1)
    line = np.hypot(y - 3.2 - t * 11, x - 2.1 - t * 14.5) <= 0.9
    cover = drawn(images.draw_lines, [[3.2, 2.1, 14.2, 16.6]], size, width=1.8)
    assert np.abs(cover - averaged(line)).max() < 0.04
    ring = np.abs(np.hypot(y - 9.3, x - 8.8) - 6.1) <= 0.75
    cover = drawn(images.draw_circles, [[9.3, 8.8, 6.1]], size, width=1.5)
    assert np.abs(cover - averaged(ring)).max() < 0.04


def test_borders_cut():
    """What is drawn on a small image is the middle of what is drawn on a larger one."""
    rng = np.random.default_rng(5)
    cases = [
        (images.draw_points, rng.random((30, 2)) * 40 - 12, {"radius": 2.5}, 2),
        (images.draw_lines, rng.random((20, 4)) * 60 - 22, {"width": 1.7}, 4),
        (images.draw_circles, rng.random((20, 3)) * 40 - (12, 12, 0), {"width": 1.7}, 2),
    ]
    for draw, shapes, options, places in cases:
        small = drawn(draw, shapes, (16, 18), **options)
        moved = np.array(shapes)
        moved[:, :places] += 40
        large = drawn(draw, moved, (96, 98), **options)
        np.testing.assert_array_equal(small, large[40:56, 40:58])


def test_far_away_and_huge():
    far = 1e9
    assert not drawn(images.draw_points, [[far, 0], [-far, far]]).any()
    diagonal = drawn(images.draw_lines, [[-far, -far, far, far]], (9, 9), width=1.0)
    assert (np.diag(diagonal) > 0.8).all()
    assert not drawn(images.draw_lines, [[far, 0, far, 9], [0, -far, 9, -far]]).any()
    rim = drawn(images.draw_circles, [[4.0, 4.0 + far, far]], (9, 9), width=1.0)
    assert (rim[:, 4] > 0.8).all()
    assert rim[:, :3].max() == 0


def test_colours_and_nothing_to_draw():
    image = noise("uint8", (12, 14, 3))
    before = image.copy()
    for draw in (images.draw_points, images.draw_lines, images.draw_circles):
        result = draw(image, [])
        assert np.array_equal(result, image)
        assert not np.shares_memory(result, image)
    colors = np.array([(10, 20, 30), (200, 100, 0)])
    result = images.draw_points(image, [(3, 3), (8, 10)], color=colors, radius=1.5)
    assert np.array_equal(result[[3, 8], [3, 10]], colors)
    swapped = images.draw_points(image, [(8, 10), (3, 3)], color=colors[::-1], radius=1.5)
    assert np.array_equal(result, swapped)
    assert np.array_equal(image, before)


def test_background_of_every_kind():
    byte = noise("uint8", (6, 7, 4))
    for image, expected in (
        (byte, byte[..., :3]),
        (byte[..., 0], byte[..., [0, 0, 0]]),
        (byte[..., 0] > 9, (byte[..., [0, 0, 0]] > 9) * np.uint8(255)),
        (byte[..., :3].astype(np.uint16) * 257, byte[..., :3]),
        (byte[..., :3] / 255, byte[..., :3]),
    ):
        assert np.array_equal(images.draw_points(image, []), expected)
    for bad, rule in (
        (np.full((3, 3), 2.0), r"\[0, 1\]"),
        (np.full((3, 3), np.nan), r"\[0, 1\]"),
        (np.ones((3, 3), np.int64), "uint8"),
        (np.ones((3, 3, 2), np.uint8), "shape"),
        (np.ones((0, 3), np.uint8), "empty"),
    ):
        with pytest.raises(ValueError, match=rule):
            images.draw_points(bad, [])


def test_overlay_mask():
    image, mask = noise("uint8", (6, 7)), noise("uint8", (6, 7), 1) > 128
    full = images.overlay_mask(image, mask, color=(1, 2, 3))
    assert (full[mask] == (1, 2, 3)).all()
    assert np.array_equal(full[~mask][:, 0], image[~mask])
    half = images.overlay_mask(image, mask, color=(255, 255, 255), opacity=0.5)
    assert np.abs(half[mask][:, 0] - (image[mask] / 2.0 + 127.5)).max() <= 0.5
    with pytest.raises(ValueError, match=r"mask must have shape \(6, 7\), got \(7, 6\)"):
        images.overlay_mask(image, mask.T)
    with pytest.raises(ValueError, match="opacity must"):
        images.overlay_mask(image, mask, opacity=1.5)


@pytest.mark.parametrize(
    ("call", "rule"),
    [
        (lambda i: images.draw_points(i, [[1, 2, 3]]), r"points must have shape \(N, 2\)"),
        (lambda i: images.draw_points(i, [1, 2]), "points must have shape"),
        (lambda i: images.draw_points(i, [[1, np.nan]]), "points must be finite"),
        (lambda i: images.draw_points(i, [[1, 2]], radius=0), "radius must be"),
        (lambda i: images.draw_lines(i, [[1, 2, 3]]), "segments must have shape"),
        (lambda i: images.draw_lines(i, [[1, 2, 3, 4]], width=-1), "width must be"),
        (lambda i: images.draw_circles(i, [[1, 2, -3]]), "radii"),
        (lambda i: images.draw_circles(i, [[1, 2, 3]], color=(0, 0, 256)), "color must"),
        (lambda i: images.draw_circles(i, [[1, 2, 3]], color=[(0, 0, 0)] * 2), "color must"),
    ],
)
def test_drawing_errors(call, rule):
    with pytest.raises(ValueError, match=rule):
        call(noise("uint8"))


@pytest.mark.parametrize("size", [41.0, 1e3, 1e6, 1e12, 1e300])
def test_shapes_far_wider_than_the_image(size):
    """In a moment, where each covered pixel of a shape was looked at: against distances."""
    image = np.zeros((30, 40), np.uint8)
    y, x = np.mgrid[:30, :40]
    for row, column in ((3.0, 5.0), (15.0, 0.9 * size + 40.0)):
        inside = np.hypot(y - row, x - column) < size - 1
        outside = np.hypot(y - row, x - column) > size + 1
        drawn = images.draw_points(image, [(row, column)], radius=size, color=(255, 255, 255))
        assert (drawn[inside] == 255).all()
        assert (drawn[outside] == 0).all()
    drawn = images.draw_lines(image, [(0, 0, 5, 5)], width=2 * size, color=(255, 255, 255))
    assert (drawn[np.hypot(y, x) < size - 1] == 255).all()
    drawn = images.draw_circles(image, [(9, 9, 7)], width=2 * size, color=(255, 255, 255))
    assert (drawn == 255).all()


@pytest.mark.parametrize(
    ("draw", "shapes", "options", "rule"),
    [
        (images.draw_lines, [(0, 0, 1, 1)], {"width": {}}, "width must be a number"),
        (images.draw_points, [("a", 1)], {}, "points must be real numbers"),
        (images.draw_points, [(1, 1)], {"color": object()}, "color must be real numbers"),
        (images.overlay_mask, GRAY, {"opacity": np.datetime64("2020")}, "opacity must be a number"),
    ],
)
def test_nonsense_is_named(draw, shapes, options, rule):
    with pytest.raises(TypeError, match=rule):
        draw(GRAY, shapes, **options)
