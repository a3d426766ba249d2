"""Pictures and paths of a field with known rays: a soft ball."""

import numpy as np
import pytest

from cvkern._runtime import runtime
from cvkern.radiance import (
    HashField,
    Model,
    Scene,
    VoxelField,
    cameras,
    evaluate,
    fit,
    look_at,
    make_scene,
    orbit_cameras,
    pixel_rays,
    point_cloud,
    render,
    render_path,
    rendering,
)
from cvkern.radiance.fields.field import Field, Frame
from cvkern.radiance.models import Training
from cvkern.radiance.rendering import Renderer, film
from cvkern.radiance.scenes.photographs import Bounds

BOUNDS = Bounds((0.5, -0.25, 1.0), 2.0, False)
RADIUS = 0.5  # radius of the ball, in halves of the cube's side: 1 in the world
COLOR = np.array([0.2, 0.5, 0.9], np.float32)


class Ball(Field):
    """A ball of one colour: rays that hit it end there."""

    def __init__(self, rt, frame):
        self.rt, self.frame, self.looks = rt, frame, []

    def see(self, origins, directions, seen, row=0):
        o, d = (self.rt.to_numpy(a).astype(float) for a in (origins, directions))
        self.looks.append(len(o))
        middle = -(o * d).sum(axis=1)
        inside = RADIUS**2 - (o**2).sum(axis=1) + middle**2
        hit = (inside > 0) & (middle > 0)  # what is behind is not seen
        depth = np.where(hit, middle - np.sqrt(np.maximum(inside, 0)), 0)
        for array, values in zip(seen, (hit[:, None] * COLOR, hit, depth), strict=True):
            self.rt.write(array, np.ascontiguousarray(values, np.float32))

    def forward(self, rays, step):
        raise AssertionError("rendering is no training")

    def taken(self):
        raise AssertionError("rendering is no training")

    def rays_for(self, samples, rays):
        raise AssertionError("rendering is no training")

    def densities(self, points):
        # exp(-density) is how much is left of light through half of the cube.
        return 100 * np.clip(1.5 - np.linalg.norm(points, axis=1) / RADIUS, 0, 1)

    def backward(self, gradients):
        raise AssertionError("rendering takes no gradients")

    def collected(self):
        raise AssertionError("rendering takes no gradients")

    def learn(self, learning):
        raise AssertionError("rendering learns nothing")

    def state(self):
        return {}

    def restore(self, state):
        pass


def some_cameras(count=5, size=24):
    turn = 2 * np.pi * np.arange(count) / count
    eyes = BOUNDS.center + 5 * np.stack((np.cos(turn), np.sin(turn), 0.5 + 0 * turn), axis=1)
    middle = 0.5 * (size - 1)
    lens = [1.5 * size, 1.5 * size, middle, middle - 3]
    return cameras(look_at(eyes, BOUNDS.center), lens, size, size - 6)


def ball():
    field = Ball(runtime(), Frame(BOUNDS, 0.1, 10.0))
    behind = np.array([1.0, 0.5, 0.0], np.float32)
    return Model(field, None, "white", behind, some_cameras(), 0, Training(), {})


def looks_of(model):
    assert isinstance(model.field, Ball)
    return model.field.looks


def hits(views, view):
    """Return for each pixel whether its ray hits the ball, and how far away; float64."""
    pixels = np.argwhere(np.ones((views.height, views.width), bool))
    origins, directions = pixel_rays(views, view, pixels)
    origins = origins - BOUNDS.center
    middle = -(origins * directions).sum(axis=1)
    inside = (RADIUS * BOUNDS.half) ** 2 - (origins**2).sum(axis=1) + middle**2
    hit = (inside > 0).reshape(views.height, views.width)
    away = (middle - np.sqrt(np.maximum(inside, 0))).reshape(hit.shape)
    return hit, away, np.abs(inside).reshape(hit.shape) > 1e-4  # not a matter of rounding


def test_pictures(backend):
    model, views = ball(), some_cameras()
    for view in (0, 3):
        picture = render(model, views, view)
        hit, away, sure = hits(views, view)
        assert sure.mean() > 0.95
        assert picture.color.shape == (*hit.shape, 3)
        assert all(part.dtype == np.float32 for part in picture)
        np.testing.assert_array_equal(picture.opacity[sure], hit[sure])
        want = np.where(hit[..., None], COLOR, model.behind)
        np.testing.assert_array_equal(picture.color[sure], want[sure])
        # Distances of about 5 in float32, in and out of the frame.
        np.testing.assert_allclose(picture.depth[hit & sure], away[hit & sure], atol=1e-4)
        assert np.isnan(picture.depth[~hit & sure]).all()
    black = render(model, views, 0, background=(0, 0, 0))
    assert (black.color[~hit & sure] == 0).all()


@pytest.mark.parametrize(("opacity", "shown"), [(0.49, False), (0.51, True)])
def test_rays_through_half_of_the_light_have_a_depth(backend, opacity, shown, monkeypatch):
    plain = Ball.see

    def see(self, origins, directions, seen, row=0):
        plain(self, origins, directions, seen)
        for array in (seen.color, seen.opacity, seen.depth):
            self.rt.write(array, self.rt.to_numpy(array) * np.float32(opacity))

    monkeypatch.setattr(Ball, "see", see)
    model, views = ball(), some_cameras()
    hit, away, sure = hits(views, 0)
    depth = render(model, views, 0).depth
    np.testing.assert_array_equal(np.isfinite(depth)[hit & sure], shown)
    if shown:  # the mean distance
        np.testing.assert_allclose(depth[hit & sure], away[hit & sure], atol=1e-4)


@pytest.mark.parametrize("most", [1, 100, 431, 432, 500])
def test_large_pictures_are_made_part_by_part(backend, most, monkeypatch):
    model, views = ball(), some_cameras()
    want = render(model, views, 1)
    monkeypatch.setattr(rendering, "RAYS", most)
    for a, b in zip(render(model, views, 1), want, strict=True):
        np.testing.assert_array_equal(a, b)
    assert sum(looks_of(model)[1:]) == views.width * views.height
    assert max(looks_of(model)[1:]) <= max(most, views.width)  # whole rows


def test_a_field_with_little_room_renders_the_same():
    scene = make_scene(train=6, test=1, size=16)
    wide = HashField(levels=8, table_bits=10, finest=64, samples=2**14, rays=300, cells=32)
    narrow = HashField(levels=8, table_bits=10, finest=64, samples=2**10, rays=40, cells=32)
    model = fit(scene, wide, steps=30)
    small = fit(scene, narrow, steps=1)
    small.field.restore(model.field.state())
    draw = Renderer(small.field, small.rt)
    for view in (2, 5):
        want = render(model, scene.cameras, view)
        got = draw(scene.cameras, view, small.behind)
        # The same sums in the same order.
        for a, b in zip(got, want, strict=True):
            np.testing.assert_array_equal(a, b)


def test_evaluate():
    model, views = ball(), some_cameras(3)
    images = np.stack([np.round(255 * render(model, views, v).color) for v in range(3)])
    images = images.astype(np.uint8)
    scene = Scene(images, views, np.array([False, True, False]), BOUNDS, 0.2, 20.0)
    seen = []
    scores = evaluate(model, scene, test=False, progress=lambda *step: seen.append(step))
    assert seen == [(1, 2), (2, 2)]
    # Rounding to bytes is off by at most 1/510, 54 dB.
    assert scores.psnr.shape == (2,)
    assert scores.psnr.min() > 54
    assert scores.ssim.min() > 0.999
    assert evaluate(model, scene).psnr.shape == (1,)
    images[1] ^= 0xFF
    assert evaluate(model, scene, views=np.array([1])).psnr[0] < 10


# ------------------------------------------------------------------------------------------ paths


def test_orbits_go_round():
    views = some_cameras(8)
    away = np.tile([0.8, 1.2], 4)[:, None]  # on average as before
    views.poses[:, :, 3] = BOUNDS.center + away * (views.poses[:, :, 3] - BOUNDS.center)
    orbit = orbit_cameras(views, 12)
    assert len(orbit) == 12
    assert (orbit.width, orbit.height) == (24, 18)
    arms = orbit.poses[:, :, 3] - BOUNDS.center
    np.testing.assert_allclose(np.hypot(arms[:, 0], arms[:, 1]), 5, rtol=1e-6)
    np.testing.assert_allclose(arms[:, 2], 2.5, rtol=1e-6)
    turns = np.diff(np.unwrap(np.arctan2(arms[:, 1], arms[:, 0])))
    np.testing.assert_allclose(np.abs(turns), 2 * np.pi / 12, rtol=1e-6)
    ahead = orbit.poses[:, :, 2]
    np.testing.assert_allclose(
        ahead, -arms / np.linalg.norm(arms, axis=1, keepdims=True), atol=1e-6
    )
    assert (orbit.poses[:, 2, 1] < 0).all()  # y is down


def test_orbits_stay_where_photographs_were_taken():
    views = some_cameras(24).select(slice(3, 9))
    arms = views.poses[:, :, 3] - BOUNDS.center
    taken = np.arctan2(arms[:, 1], arms[:, 0])
    arms = orbit_cameras(views, 10).poses[:, :, 3] - BOUNDS.center
    angles = np.arctan2(arms[:, 1], arms[:, 0])
    # The way up is that of the cameras on average, and those lean to the middle of their arc.
    assert angles.min() == pytest.approx(taken.min(), abs=0.03)
    assert angles.max() == pytest.approx(taken.max(), abs=0.03)


def test_larger_and_smaller_pictures():
    views = some_cameras()
    large = views.scaled(2.5)
    assert (large.width, large.height) == (60, 45)
    corners = np.array([(-0.5, -0.5), (17.5, 23.5)])
    for a, b in zip(pixel_rays(views, 2, corners), pixel_rays(large, 2, 2.5 * corners + 0.75),
                    strict=True):  # fmt: skip
        np.testing.assert_allclose(a, b, atol=1e-12)
    assert render(ball(), large, 0).color.shape == (45, 60, 3)
    assert orbit_cameras(views, 2, factor=0.5).width == 12


def test_films():
    frames = film(ball(), some_cameras())
    assert frames.shape == (5, 18, 24, 3)
    assert frames.dtype == np.uint8
    want = np.round(255 * render(ball(), some_cameras(), 4).color)
    np.testing.assert_array_equal(frames[4], want)


def test_render_path(tmp_path):
    import imageio.v3 as iio

    done, path = [], some_cameras()
    arms = path.poses[:, :, 3] - BOUNDS.center
    path.poses[:, :, 3] += 0.1 * np.arange(5)[:, None] * arms  # or all frames were the same
    render_path(ball(), path, tmp_path / "path.gif", progress=lambda *n: done.append(n))
    assert done == [(n, 5) for n in range(1, 6)]
    assert iio.imread(tmp_path / "path.gif").shape == (5, 18, 24, 3)


def with_one_at(distance):
    """Return cameras, one of them so many halves of the cube's side from its middle."""
    views = some_cameras()
    arm = views.poses[3, :, 3] - BOUNDS.center
    views.poses[3, :, 3] = BOUNDS.center + distance * BOUNDS.half * arm / np.linalg.norm(arm)
    return views


def scene_of(views):
    images = np.zeros((len(views), views.height, views.width, 3), np.uint8)
    return Scene(images, views, np.arange(len(views)) == 3, BOUNDS, 0.1, 1e9)


@pytest.mark.parametrize(
    "look",
    [
        lambda model, views: render(model, views, 3),
        lambda model, views: film(model, views),
        lambda model, views: point_cloud(model, views),
        lambda model, views: evaluate(model, scene_of(views)),
        lambda model, views: evaluate(model, scene_of(views), test=False, views=[0, 3]),
        lambda model, views: fit(scene_of(views), steps=1),
    ],
)
def test_cameras_that_are_too_far_away(look):
    """Theirs are views that a step along a ray may not get nearer to."""
    model = ball()
    message = "cameras must be within 32768 half-sides of the scene's cube from its middle, got "
    with pytest.raises(ValueError, match=message + "one at 32800$"):
        look(model, with_one_at(32800))
    assert looks_of(model) == []
    render(model, with_one_at(32800), 2)
    render(model, with_one_at(32768 - 1e-6), 3)


@pytest.mark.parametrize(
    "field",
    [
        HashField(levels=8, table_bits=10, samples=2**12, rays=64, cells=32),
        VoxelField(resolutions=(16,), shares=(), spacing=0.016, thin=1e-6),
    ],
    ids=["hash", "voxel"],
)
def test_cameras_as_far_away_as_may_be(backend, field):
    """A step of the finest field there is comes to more than float32 rounds off."""
    views = with_one_at(32768 - 1e-6)
    net = field.build(runtime(), Frame(BOUNDS, 0.0, 1e9), 0)
    lens = np.array([[32768 * 24, 32768 * 24, 11.5, 8.5]])
    near = cameras(views.poses[3:4], lens, 24, 18)
    picture = Renderer(net, runtime())(near, 0, np.ones(3, np.float32))
    assert picture.opacity.min() > 0.1  # fog, all over the picture


def test_render_path_refuses_before_it_renders(tmp_path):
    model = ball()
    with pytest.raises(ValueError, match=r"path must end in .gif or .mp4, got 'path.png'"):
        render_path(model, some_cameras(), "path.png")
    with pytest.raises(FileNotFoundError, match="path must lie in a folder that exists"):
        render_path(model, some_cameras(), tmp_path / "none" / "path.gif")
    (tmp_path / "path.gif").mkdir()
    with pytest.raises(ValueError, match="path must name a regular file"):
        render_path(model, some_cameras(), tmp_path / "path.gif")
    assert looks_of(model) == []
