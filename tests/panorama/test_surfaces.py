"""The axes and the size of panoramas, against closed forms."""

import math

import numpy as np
import pytest

from cvkern.panorama.cropping import largest_rectangle
from cvkern.panorama.models import Alignment
from cvkern.panorama.surfaces import lay_out, straighten
from tests.panorama.scenes import angle_between, turned

SIDE = np.array([401, 301])
FOCAL = 400.0


def alignment(rotations, focal=FOCAL):
    """Return cameras, each hanging on the one before."""
    rotations = np.stack(rotations)
    count = len(rotations)
    matrices = np.diag([focal, focal, 1.0]) @ rotations
    return Alignment("rotation", matrices, np.full(count, focal), rotations,
                     np.arange(count) - 1, 0.0)  # fmt: skip


def laid_out(rotations, surface="auto", scale=1.0, focal=FOCAL):
    found = alignment(rotations, focal)
    return lay_out(found, np.tile(SIDE, (len(rotations), 1)), surface, scale)


TILT = turned(25, 20, 12)  # Rotation of the axes that the cameras are given in.


@pytest.mark.parametrize(
    "views",
    [
        [(20 * i, 0, 0) for i in range(5)],  # in a row
        [(20 * i, 8 * (-1) ** i, 0) for i in range(6)],  # up and down
        [(360 / 9 * i, 5, 0) for i in range(9)],  # all round
        [(20 * i, 0, 90 * (i % 2)) for i in range(5)],  # two upright, three not
        [(0, 15 * i - 30, 0) for i in range(5)],  # one above the other
    ],
)
def test_straighten(views):
    rotations = [turned(*view) for view in views]
    level = straighten(np.stack([r @ TILT for r in rotations]), np.arange(len(views)) - 1)
    # The vertical of the world is that of the panorama; where all look is nobody's matter.
    down = np.stack([m.T @ r[:, 1] for m, r in zip(level, rotations, strict=True)])
    assert np.degrees(np.arccos(down[:, 1].clip(-1, 1))).max() < 1e-3
    for i in range(len(views)):
        between = level[i] @ level[0].T
        assert angle_between(between, rotations[i] @ rotations[0].T) < 1e-4


def test_a_few_cameras_make_a_plane():
    canvas = laid_out([turned(-10), turned(10)])
    assert canvas.surface == "plane"
    assert not canvas.closed
    reach = math.tan(math.radians(10) + math.atan(200 / FOCAL)) * FOCAL
    assert canvas.width == pytest.approx(2 * reach + 1, abs=2)
    # Half the size has half the pixels on a side.
    half = laid_out([turned(-10), turned(10)], scale=0.5)
    assert half.width == pytest.approx(canvas.width / 2, abs=2)


@pytest.mark.parametrize("surface", ["auto", "plane", "cylinder", "sphere"])
def test_a_round_view_is_closed(surface):
    canvas = laid_out([turned(30 * i, 4) for i in range(12)], surface)
    assert canvas.surface == ("sphere" if surface == "sphere" else "cylinder")
    assert canvas.closed
    assert canvas.width == round(2 * math.pi * FOCAL)
    assert canvas.step * canvas.width == pytest.approx(2 * math.pi)
    np.testing.assert_allclose(canvas.columns(-5, 3), canvas.columns(canvas.width - 5, 3))


def test_the_ends_are_in_the_gap():
    yaws = [100, 140, 180, -140, -100, -60]
    canvas = laid_out([turned(y) for y in yaws])
    assert not canvas.closed
    half = math.degrees(math.atan(200 / FOCAL))
    assert canvas.width * canvas.step == pytest.approx(math.radians(200 + 2 * half), abs=0.01)
    # Every image lies within the canvas where its rectangle says.
    for matrix, (x0, y0, x1, y1) in zip(canvas.matrices, canvas.rects, strict=True):
        assert 0 <= x0 < x1 <= canvas.width
        assert 0 <= y0 < y1 <= canvas.height
        (a, b), (p, q) = canvas.columns((x0 + x1) // 2, 1)[0], canvas.rows((y0 + y1) // 2, 1)[0]
        x, y, z = matrix @ (a * p, q, b * p)
        assert z > 0
        np.testing.assert_allclose((x / z, y / z), (SIDE - 1) / 2, atol=2)


def test_a_view_upwards_is_a_sphere():
    canvas = laid_out([*(turned(45 * i, 5) for i in range(8)), turned(0, 80), turned(0, 45)])
    assert canvas.surface == "sphere"
    ends = canvas.top, canvas.top + (canvas.height - 1) * canvas.step
    assert max(map(abs, ends)) == pytest.approx(math.pi / 2, abs=canvas.step)
    widths = canvas.rects[:, 2] - canvas.rects[:, 0]
    assert widths.max() == canvas.width  # what holds the pole goes all round


def test_coarser():
    canvas = laid_out([turned(30 * i) for i in range(12)])
    coarse = canvas.coarser(7.3)
    assert coarse.closed
    assert coarse.step * coarse.width == pytest.approx(2 * math.pi)
    factor = coarse.step / canvas.step
    # The middle of a coarse pixel is that of the pixels it stands for.
    assert coarse.left == pytest.approx(canvas.left + (factor - 1) / 2 * canvas.step)


def covered_alone(mask):
    """Return the area of the largest rectangle, by trying all."""
    sums = np.pad(mask.astype(int).cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    best = 0
    for top in range(mask.shape[0]):
        for bottom in range(top + 1, mask.shape[0] + 1):
            for left in range(mask.shape[1]):
                for right in range(left + 1, mask.shape[1] + 1):
                    area = (bottom - top) * (right - left)
                    inside = (
                        sums[bottom, right]
                        - sums[top, right]
                        - sums[bottom, left]
                        + sums[top, left]
                    )
                    best = max(best, area if inside == area else 0)
    return best


@pytest.mark.parametrize("share", [0.0, 0.6, 0.9, 1.0])
def test_largest_rectangle(share):
    mask = np.random.default_rng(0).random((9, 11)) < share
    top, left, bottom, right = largest_rectangle(mask)
    if share:
        assert mask[top:bottom, left:right].all()
        assert (bottom - top) * (right - left) == covered_alone(mask)
    else:
        assert (top, left, bottom, right) == (0, 0, 9, 11)
    big = np.kron(mask, np.ones((160, 160), bool))  # searched in blocks
    top, left, bottom, right = largest_rectangle(big)
    assert big[top:bottom, left:right].all() == (share > 0)
