"""Multiplane images without training, and as files: against what cameras would see."""

import base64
import json
import re
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from cvkern.images import read_image
from cvkern.radiance import (
    cameras,
    fit,
    load_model,
    make_scene,
    planes_from_depth,
    planes_from_stereo,
    render,
    write_planes,
)
from cvkern.radiance.fields.planes import PlaneStack
from tests.radiance.runs import GRID

HEIGHT, WIDTH, FOCAL = 30, 44, 40.0
K = np.array([[FOCAL, 0, 21.5], [0, FOCAL, 14.5], [0, 0, 1]])
RNG = np.random.default_rng(0)
IMAGE = RNG.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)


def moved(right, down=0.0, forward=0.0):
    """Return the photograph's camera, moved."""
    pose = np.column_stack((np.eye(3), [right, down, forward]))
    return cameras(pose[None], [FOCAL, FOCAL, 21.5, 14.5], WIDTH, HEIGHT)


@pytest.mark.usefixtures("backend")
def test_the_photograph_itself():
    """8 bits of a colour times an opacity: two planes, each rounded by half a level."""
    rows = np.linspace(2, 6, HEIGHT)[:, None]
    model = planes_from_depth(IMAGE, np.broadcast_to(rows, (HEIGHT, WIDTH)), K, planes=6)
    seen = render(model, model.cameras)
    assert np.abs(255 * seen.color - IMAGE).max() <= 2.5
    assert seen.opacity.min() > 0.995
    # Planes are 0.067 apart in 1 / depth, and a pixel has the mean of the depths of two.
    ahead = seen.depth / np.hypot(
        1,
        np.hypot(
            *np.meshgrid((np.arange(WIDTH) - 21.5) / FOCAL, (np.arange(HEIGHT) - 14.5) / FOCAL)
        ),
    )
    assert np.abs(ahead / rows - 1).max() < 0.08


@pytest.mark.parametrize("planes", [1, 2, 5])
def test_a_wall_moves_as_a_whole(planes):
    model = planes_from_depth(IMAGE, np.full((HEIGHT, WIDTH), 4.0), K, planes=planes)
    seen = render(model, moved(0.5, -0.2))  # 5 pixels to the left, 2 down
    np.testing.assert_allclose(255 * seen.color[2:, :-5], IMAGE[:-2, 5:], atol=2)
    assert not seen.opacity[:2].any()
    assert not seen.opacity[:, -5:].any()
    near = render(model, moved(0, 0, 2.0))  # twice as large
    wanted = IMAGE[7:22:, 11:32].astype(float)
    np.testing.assert_allclose(
        255 * near.color[1::2, 1:42:2][:14, :20].mean(), wanted.mean(), atol=6
    )


def box_before_wall():
    """Return a photograph of a blue box, 2 away, before a red wall, 8 away, and its depths."""
    image, depth = (
        np.full((HEIGHT, WIDTH, 3), (200, 40, 30), np.uint8),
        np.full(IMAGE.shape[:2], 8.0),
    )
    image[8:22, 14:28], depth[8:22, 14:28] = (20, 40, 220), 2.0
    return image, depth


def test_surfaces_go_on_behind_nearer_ones():
    image, depth = box_before_wall()
    seen = render(planes_from_depth(image, depth, K, planes=4), moved(0.1))  # 2 and 0.5 pixels
    assert seen.opacity[:, 2:-2].min() > 0.995
    np.testing.assert_allclose(255 * seen.color[8:22, 12:26], image[8:22, 14:28], atol=2)
    np.testing.assert_allclose(255 * seen.color[8:22, 27:40], image[:14, :13], atol=2)
    bare = render(planes_from_depth(image, depth, K, planes=4, reach=0), moved(0.1))
    assert bare.opacity[10:20, 26:27].max() < 0.6  # a hole


def test_what_is_unknown_is_far():
    image, depth = box_before_wall()
    depth[:4] = np.nan
    depth[4:6] = np.inf
    depth[:, :3] = 0
    model = planes_from_depth(image, depth, K, planes=4)
    away = render(model, model.cameras).depth
    assert np.nanmin(away[:6]) > 7.9
    assert np.nanmin(away[:, :3]) > 7.9
    fixed = planes_from_depth(image, depth, K, planes=4, near=1.0, far=20.0)
    assert isinstance(fixed.field, PlaneStack)
    found = fixed.frame.bounds.half / fixed.field.reference.disparities
    np.testing.assert_allclose(found[[0, -1]], [1, 20])


def texture(height, width):
    """Return smooth noise, because disparities are between pixels."""
    noise = gaussian_filter(RNG.normal(size=(height, width, 3)), (1, 1, 0))
    return np.round(128 + 200 * noise).clip(0, 255).astype(np.uint8)


def test_a_pair():
    wide = texture(HEIGHT, WIDTH + 20)
    left, right = wide[:, 8:52].copy(), wide[:, 10:54].copy()  # the wall: 2 pixels
    left[8:22, 14:28] = right[8:22, 8:22] = texture(14, 14)  # 6
    model = planes_from_stereo(left, right, K, disparities=(0, 10), baseline=0.5, planes=9)
    away = render(model, model.cameras).depth
    assert np.median(away[10:20, 16:26]) == pytest.approx(FOCAL * 0.5 / 6, rel=0.06)
    assert np.median(away[:, 32:]) == pytest.approx(FOCAL * 0.5 / 2, rel=0.12)
    # The right camera sees the right photograph, apart from what the left one does not.
    seen = render(model, moved(0.5)).color
    off = np.abs(255 * seen - right)[:, : WIDTH - 8]
    assert np.median(off) < 5  # neighbours differ by 20 on average


def test_planes_as_files(tmp_path):
    image, depth = box_before_wall()
    model = planes_from_depth(image, depth, K, planes=5)
    model.save(tmp_path / "model.npz")
    read = load_model(tmp_path / "model.npz")
    np.testing.assert_array_equal(
        render(read, read.cameras).color, render(model, model.cameras).color
    )
    write_planes(model, tmp_path / "planes.png")
    facts = json.loads((tmp_path / "planes.json").read_text())
    atlas = read_image(tmp_path / "planes.png")
    rows = -(-5 // facts["columns"])
    assert atlas.shape == (rows * HEIGHT, facts["columns"] * WIDTH, 4)
    np.testing.assert_allclose(np.array(facts["depths"])[[0, -1]], [2, 8], rtol=1e-3)
    assert facts["lens"] == [FOCAL, FOCAL, 21.5, 14.5]
    cells = atlas.reshape(rows, HEIGHT, facts["columns"], WIDTH, 4).swapaxes(1, 2)
    cells = cells.reshape(-1, HEIGHT, WIDTH, 4).astype(float) / 255
    over = np.zeros((HEIGHT, WIDTH, 3))
    for cell in cells[4::-1]:  # from the back, as a painter does
        over = cell[..., 3:] * cell[..., :3] + (1 - cell[..., 3:]) * over
    np.testing.assert_allclose(255 * over, image, atol=2)
    write_planes(model, tmp_path / "page.html", motion=0.1, background=(0, 0.5, 1))
    page = (tmp_path / "page.html").read_text()
    (held,) = re.findall(r"base64,([A-Za-z0-9+/=]+)", page)
    np.testing.assert_array_equal(iio.imread(base64.b64decode(held), extension=".png"), atlas)
    found = json.loads(re.findall(r"const facts = (\{.*\});", page)[0])
    assert found == facts | {"motion": 0.1}
    assert "[0.0000, 0.5000, 1.0000]" in page
    assert "http" not in page  # it needs no network
    assert sorted(f.name for f in tmp_path.iterdir()) == [
        "model.npz", "page.html", "planes.json", "planes.png",
    ]  # fmt: skip


def test_refusals(tmp_path):
    depth = np.ones((HEIGHT, WIDTH))
    good: dict[str, Any] = {"image": IMAGE, "depth": depth, "K": K}
    mistakes: Any = (
        (TypeError, "image must be uint8, got float64", {"image": IMAGE / 255}),
        (ValueError, r"image must have shape \(H, W, 3\)", {"image": IMAGE[..., 0]}),
        (ValueError, r"depth must have shape \(30, 44\), got \(44, 30\)", {"depth": depth.T}),
        (ValueError, "depth must not be negative, got -1", {"depth": -depth}),
        (ValueError, "depth must be finite and > 0 somewhere", {"depth": np.nan * depth}),
        (ValueError, "depth must be finite and > 0 somewhere", {"depth": 1e-320 * depth}),
        (ValueError, "K must be a camera matrix", {"K": np.zeros((3, 3))}),
        (ValueError, r"planes must be in \[1, 512\], got 0", {"planes": 0}),
        (ValueError, "near must be below far, got 5 and 4", {"near": 5.0, "far": 4.0}),
        (ValueError, "reach must be", {"reach": -1}),
    )
    for error, message, given in mistakes:
        with pytest.raises(error, match=message):
            planes_from_depth(**good | given)
    with pytest.raises(ValueError, match=r"right must have shape \(30, 44, 3\)"):
        planes_from_stereo(IMAGE, IMAGE[:, 1:], K)
    with pytest.raises(ValueError, match="baseline must be > 0"):
        planes_from_stereo(IMAGE, IMAGE, K, baseline=0.0)
    model = planes_from_depth(**good)
    scene = make_scene(train=3, test=0, size=16)
    mistakes = (
        (ValueError, r"path must end in \.html or \.png", {"path": tmp_path / "a.jpg"}),
        (FileNotFoundError, "none", {"path": tmp_path / "none" / "a.html"}),
        (ValueError, r"motion must lie in \[0, 1\], got 2", {"motion": 2.0}),
        (ValueError, "background must be three numbers", {"background": (1, 2, 3)}),
        (ValueError, "model must be of a PlanesField, got VoxelField",
         {"model": fit(scene, GRID, steps=1, progress=False)}),
    )  # fmt: skip
    for error, message, given in mistakes:
        with pytest.raises(error, match=message):
            write_planes(**{"model": model, "path": tmp_path / "a.html"} | given)
    assert not list(tmp_path.iterdir())
