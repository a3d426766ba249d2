"""The synthetic scene, against distances in NumPy and by looking at it from two sides."""

import numpy as np
import pytest

import cvkern
from cvkern.radiance import make_scene, pixel_rays, project
from cvkern.radiance.scenes.solids import BALL, BOUNDS, SOLIDS
from tests.radiance.scenes.reference_solids import distances


def depths_of(scene):
    assert scene.depths is not None
    return scene.depths


def seen(scene, view):
    """Return the pixels of a view that show something, and the points there."""
    pixels = np.argwhere(np.isfinite(depths_of(scene)[view]))
    origins, directions = pixel_rays(scene.cameras, view, pixels)
    away = depths_of(scene)[view][tuple(pixels.T)][:, None]
    return pixels, origins + away * directions


def test_rays_end_on_the_solids(backend):
    scene = make_scene(train=3, test=0, size=40, samples=1)
    for view in range(3):
        pixels, points = seen(scene, view)
        assert len(pixels) > 300
        assert (scene.images[view, ..., 3] == 255 * np.isfinite(depths_of(scene)[view])).all()
        # A walk ends 1e-3 before a surface; float32 and the bound for ellipsoids add a little.
        assert np.abs(distances(SOLIDS, points).min(axis=0)).max() < 1.5e-3
        origins, directions = pixel_rays(scene.cameras, view, pixels)
        for share in (0.9, 0.99):  # and nothing is in the way
            way = share * depths_of(scene)[view][tuple(pixels.T)][:, None]
            assert distances(SOLIDS, origins + way * directions).min() > 0
        missed = np.argwhere(np.isnan(depths_of(scene)[view]))
        origins, directions = pixel_rays(scene.cameras, view, missed)
        for way in np.linspace(scene.near, scene.far, 60):
            assert distances(SOLIDS, origins + way * directions).min() > 0


def test_every_solid_is_seen():
    scene = make_scene(train=4, test=0, size=60)
    points = np.concatenate([seen(scene, view)[1] for view in range(4)])
    nearest = distances(SOLIDS, points).argmin(axis=0)
    assert (np.bincount(nearest, minlength=len(SOLIDS)) > 20).all()


def test_views_agree():
    """What one camera sees, another sees in the same place, unless something is before it."""
    scene = make_scene(train=8, test=0, size=120, samples=1)
    _, points = seen(scene, 7)
    at = np.round(project(scene.cameras, 4, points)).astype(int)
    inside = ((at >= 0) & (at < 120)).all(axis=1)
    there = depths_of(scene)[4][tuple(at[inside].T)]
    eye = scene.cameras.poses[4][:, 3]
    away = np.linalg.norm(points[inside] - eye, axis=1)
    # A pixel covers about 0.02; a surface seen aslant is deeper at its rim.
    same = np.abs(there - away) < 0.05
    before = there < away
    assert (same | before)[np.isfinite(there)].mean() > 0.97
    assert same.mean() > 0.5


def test_both_sets_make_the_same_pictures():
    warp = make_scene(train=2, test=0, size=48)
    with cvkern.use(backend="taichi"):
        taichi = make_scene(train=2, test=0, size=48)
    off = np.abs(warp.images.astype(int) - taichi.images)
    # Rounding to bytes may fall to either side; rays that graze a rim may miss it.
    assert (off > 1).mean() < 1e-3


def test_gloss_is_seen_from_one_side_only():
    """The same point of the red ball differs from view to view, and one of the plinth does less."""
    scene = make_scene(train=24, test=0, size=100)
    spread = {}
    for name, point in (("ball", (0.36, -0.22, 0.68)), ("plinth", (0.0, 0.9, 0.0))):
        colors = []
        for view in range(len(scene)):
            row, column = np.round(project(scene.cameras, view, [point])[0]).astype(int)
            away = np.linalg.norm(scene.cameras.poses[view][:, 3] - point)
            if abs(depths_of(scene)[view, row, column] - away) < 0.02:
                colors.append(scene.images[view, row, column, :3].astype(float).mean())
        assert len(colors) > 5
        spread[name] = np.ptp(colors)
    assert spread["ball"] > 40
    assert spread["ball"] > 2 * spread["plinth"]


def test_what_a_scene_holds():
    scene = make_scene(train=5, test=2, size=32)
    assert scene.images.shape == (7, 32, 32, 4)
    assert depths_of(scene).shape == (7, 32, 32)
    assert scene.test.sum() == 2
    assert not scene.test[0]
    opacity = scene.images[..., 3]
    assert ((opacity > 0) & (opacity < 255)).any()  # rims are smooth
    corners = np.concatenate([seen(scene, view)[1] for view in range(7)])
    assert (np.abs(corners - BOUNDS.center) < BOUNDS.half).all()
    assert (np.linalg.norm(corners - BALL[:3], axis=1) < BALL[3] + 2e-3).all()
    away = np.nanmin(depths_of(scene)), np.nanmax(depths_of(scene))
    assert scene.near < away[0] < away[1] < scene.far


@pytest.mark.parametrize(
    ("options", "error", "rule"),
    [
        ({"train": 0}, ValueError, r"train must be in \[1, 10000\], got 0"),
        ({"test": -1}, ValueError, r"test must be in \[0, 10000\], got -1"),
        ({"size": 0}, ValueError, r"size must be in \[1, 4096\], got 0"),
        ({"size": 2.5}, TypeError, "size must be an integer, got 2.5"),
        ({"samples": 9}, ValueError, r"samples must be in \[1, 8\], got 9"),
    ],
)
def test_errors(options, error, rule):
    with pytest.raises(error, match=rule):
        make_scene(**options)
