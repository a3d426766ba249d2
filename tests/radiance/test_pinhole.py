"""Rays through the pixels of cameras: those of a view, and random ones with their targets."""

import numpy as np
import pytest

from cvkern import radiance
from cvkern.kernels.codes.radiance import CameraSet
from tests.radiance import reference_radiance as reference

F32, I32, U8 = np.float32, np.int32, np.uint8


def cameras(views, seed=0, distorted=True):
    """Return poses and lenses of cameras about the origin, of about 90 degrees."""
    rng = np.random.default_rng(seed)
    turns = np.linalg.qr(rng.normal(size=(views, 3, 3)))[0]
    turns[:, :, 0] *= np.linalg.det(turns)[:, None]
    poses = np.concatenate([turns, rng.normal(size=(views, 3, 1))], 2)
    lenses = np.zeros((views, 9))
    lenses[:, :4] = rng.uniform([9, 10, 7, 5], [10, 11, 8, 6], (views, 4))
    if distorted:
        lenses[:, 4:] = rng.uniform(-1, 1, (views, 5)) * [0.1, 0.02, 0.01, 0.01, 0.005]
    return poses.astype(F32), lenses.astype(F32)


def project(points, pose, lens):
    """Return the (column, row) of points of the world, by OpenCV."""
    cv2 = pytest.importorskip("cv2")
    inverse = np.linalg.inv(np.vstack([pose, [0, 0, 0, 1]]).astype(float))
    matrix = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]], float)
    rotation = cv2.Rodrigues(inverse[:3, :3])[0]
    return cv2.projectPoints(points.astype(float), rotation, inverse[:3, 3], matrix, lens[4:])[0][
        :, 0
    ]


@pytest.mark.parametrize("distorted", [False, True])
def test_view_rays_meet_their_pixels(kernels, distorted):
    width, height, begin = 16, 12, 37
    poses, lenses = cameras(3, distorted=distorted)
    count = width * height - begin
    for view in range(3):
        origins, directions = kernels(
            "radiance.pinhole.view_rays", CameraSet(poses, lenses, width, height), view, begin,
            out=[((count, 3), F32)] * 2,
        )  # fmt: skip
        np.testing.assert_array_equal(origins, np.tile(poses[view, :, 3], (count, 1)))
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
        pixels = begin + np.arange(count)
        found = project(origins + 2.0 * directions.astype(float), poses[view], lenses[view])
        want = np.stack([pixels % width, pixels // width], 1)
        # Newton's method ends within the rounding of its terms; a pixel is 0.1 of the focal length.
        np.testing.assert_allclose(found, want, rtol=0, atol=1e-4)


def test_view_rays_of_pixels_that_no_point_is_seen_at(kernels):
    """Behind the fold of a lens Newton's method ends anywhere: rays must have a direction."""
    size = 400
    poses = np.eye(3, 4, dtype=F32)[None]
    middle, focal = size / 2, size / 2.4
    lens = np.array([[focal, focal, middle, middle, -0.35, 0.15, 1e-3, 1e-3, -0.03]], F32)
    rays = [((size * size, 3), F32)] * 2
    views = CameraSet(poses, lens, size, size)
    _, directions = kernels("radiance.pinhole.view_rays", views, 0, 0, out=rays)
    # Two sums, a root and a quotient are rounded.
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=0, atol=4 * 2**-23)


@pytest.mark.parametrize("channels", [3, 4])
def test_random_rays_are_those_of_the_pixels_they_show(kernels, channels):
    width, height, count, rays = 16, 12, 3, 3000
    poses, lenses = cameras(count)
    pixels = np.arange(count * width * height)
    images = np.stack([pixels & 255, pixels >> 8, 9 * pixels & 255, 5 * pixels & 255], 1)
    images = images[:, :channels].astype(U8)

    def draw(spread, step=7, chosen: int | np.ndarray = -1):
        step, chosen = np.array([step], I32), np.atleast_1d(chosen).astype(I32)
        given = CameraSet(poses, lenses, width, height), images, spread, 11, step, chosen
        out = [((rays, 3), F32), ((rays, 3), F32), ((rays, 4), F32), (rays, I32), (rays, I32)]
        return kernels("radiance.pinhole.random_rays", *given, out=out)

    origins, directions, targets, views, places = draw(0.0)
    bytes_ = np.round(targets * 255).astype(int)
    pixel = bytes_[:, 0] + 256 * bytes_[:, 1]
    np.testing.assert_array_equal(
        pixel, reference.random_index(11, 7, np.arange(rays), 0, len(pixels))
    )
    np.testing.assert_array_equal(bytes_[:, :channels], images[pixel])
    np.testing.assert_array_equal(views * width * height + places, pixel)
    if channels == 3:
        assert (targets[:, 3] == 1).all()
    for view in range(count):
        own = pixel // (width * height) == view
        assert own.sum() > rays / 6
        out = [((width * height, 3), F32)] * 2
        views = CameraSet(poses, lenses, width, height)
        whole = kernels("radiance.pinhole.view_rays", views, view, 0, out=out)
        within = pixel[own] % (width * height)
        np.testing.assert_array_equal(origins[own], whole[0][within])
        np.testing.assert_allclose(directions[own], whole[1][within], rtol=0, atol=1e-6)

    few = np.flatnonzero(pixels % 7 == 3)
    given = draw(0.0, chosen=few)
    index = reference.random_index(11, 7, np.arange(rays), 0, len(few))
    np.testing.assert_array_equal(given[3] * width * height + given[4], few[index])

    _, spread_out, again, *_ = draw(1.0)
    np.testing.assert_array_equal(again, targets)  # the same pixels
    for view in range(count):
        own = pixel // (width * height) == view
        points = origins[own] + 2.0 * spread_out[own].astype(float)
        within = pixel[own] % (width * height)
        off = project(points, poses[view], lenses[view])
        off = off - np.stack([within % width, within // width], 1)
        assert np.abs(off).max() < 0.5 + 1e-4
        # Uniform: of mean 0 and variance 1 / 12, here of about 1000 values.
        np.testing.assert_allclose(off.mean(0), 0, atol=5 * np.sqrt(1 / 12 / own.sum()))
        np.testing.assert_allclose((off**2).mean(0), 1 / 12, rtol=0.2)
    assert (draw(0.0, step=8)[2] != targets).any(1).mean() > 0.9


@pytest.mark.parametrize(("change", "factor"), [("resized", 1 / 3), ("scaled", 2.5)])
def test_a_pixel_of_another_size_covers_the_same_part_of_the_view(change, factor):
    """Pixel centres are integers: the corner of the image, half a pixel before, stays."""
    views = radiance.cameras(np.eye(4)[None], [90.0, 80.0, 44.2, 31.7], 90, 63)
    points = np.random.default_rng(2).uniform((-1, -1, 3), (1, 1, 9), (20, 3))
    other = views.resized(3) if change == "resized" else views.scaled(factor)
    want = (radiance.project(views, 0, points) + 0.5) * factor - 0.5
    np.testing.assert_allclose(radiance.project(other, 0, points), want, rtol=0, atol=1e-9)
    assert (other.width, other.height) == (round(90 * factor), round(63 * factor))
