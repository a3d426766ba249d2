"""Local Laplacian filters against their definition, and what tone curves must keep."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.ndimage

import cvkern
from cvkern._runtime import runtime
from cvkern.raw.bands import local_laplacian
from tests.raw import reference_pyramids as reference

METHODS = ("reinhard", "reinhard_local", "bilateral", "local_laplacian")


def filtered(image, references, sigma, slope):
    rt = runtime(image)
    low, step = float(image.min()), float(np.ptp(image)) / (references - 1)
    levels = rt.adopt(image, np.float32, (1, *image.shape))
    found = local_laplacian(rt, levels, low, step, references, sigma, slope)
    return np.array(rt.to_numpy(found))[0]


def walk(shape):
    return np.cumsum(np.random.default_rng(0).normal(size=shape), axis=1).astype(np.float32)


@pytest.mark.parametrize("shape", [(20, 24), (37, 270), (5, 540), (1, 9), (3, 2)])
def test_the_filter_is_that_of_the_fast_equations(backend, shape):
    """In float32: a rounding of 30 is 2e-6, and a few of them add up."""
    image = walk(shape)
    levels = 1 + max(1, int(np.log2(min(shape))))
    want = reference.fast_local_laplacian(image.astype(float), levels, 1.0, 0.2, 9)
    np.testing.assert_allclose(filtered(image, 9, 1.0, 0.2), want, rtol=0, atol=2e-5)


def test_the_filter_nears_its_definition():
    """Between references it is a straight line: what that is off falls with their distance."""
    image = walk((20, 24))
    want = reference.local_laplacian(image.astype(float), 5, 1.0, 0.2)
    off = [np.abs(filtered(image, count, 1.0, 0.2) - want).mean() for count in (17, 33, 65)]
    assert off[1] < off[0] / 2
    assert off[2] < off[1] / 2
    assert off[2] < 2e-3


def test_nothing_changes_where_edges_keep_their_size(backend):
    """In float32, as above."""
    image = walk((40, 31))
    np.testing.assert_allclose(filtered(image, 9, 1.0, 1.0), image, rtol=0, atol=2e-5)


@pytest.mark.parametrize("method", METHODS)
def test_both_sets_have_the_same_bits(method):
    rng = np.random.default_rng(1)
    radiance = np.exp(rng.normal(0, 3, (70, 90, 3))).astype(np.float32)
    radiance[3, 4], radiance[9] = np.nan, 0
    answers = []
    for name in ("warp", "taichi"):
        with cvkern.use(name):
            answers.append(cvkern.tone_map(radiance, method))
    np.testing.assert_array_equal(*answers)
    assert not answers[0][3, 4].any()
    assert not answers[0][9].any()


def test_an_edge_gets_no_halo(backend):
    """Of a step of 10 stops, 7 are taken off; either side bends by a twelfth of that at most.

    So it is by the definition, over the whole side. A linear filter bends each by half of it.
    """
    step = np.where(np.arange(256) < 128, 1.0, 1024.0) * np.ones((96, 1))
    texture = 1 + 0.1 * np.sin(np.arange(256))
    shown = cvkern.tone_map(step * texture, "local_laplacian", contrast=8)
    logs = np.log2(shown / texture)
    for side in (logs[:, 4:126], logs[:, 130:252]):
        assert np.ptp(side) < 7 / 12
        assert np.abs(np.diff(side, axis=1)).max() < 0.05
    assert logs[:, 200].mean() - logs[:, 50].mean() == pytest.approx(3, abs=0.1)


def test_the_base_and_not_its_details_gets_the_contrast(backend):
    """Of 12 stops between two sides 4 are left, and details keep their 0.4 stops to either side."""
    sides = np.where(np.arange(120) < 60, 0.0, 12.0) * np.ones((80, 1))
    details = 0.4 * (2 * (np.indices(sides.shape).sum(axis=0) % 2) - 1)
    logs = np.log2(cvkern.tone_map(2 ** (sides + details), "bilateral", contrast=16))
    dark, bright = (logs[:, part][details[:, part] < 0] for part in (slice(8, 45), slice(75, 112)))
    # The brighter pixels of the bright side are white. The base follows details by 0.04 stops; if
    # it were measured with them, 12.8 stops for 4 would leave 3.75.
    assert bright.mean() - dark.mean() == pytest.approx(4 * 12 / 12.08, abs=0.05)
    assert np.ptp(logs[8:-8, 8:45]) == pytest.approx(0.8 - 0.08, abs=0.02)


def test_one_brightness_is_white():
    np.testing.assert_allclose(cvkern.tone_map(np.full((9, 7), 3.0), "local_laplacian"), 1)


def test_surroundings_are_those_of_the_paper(backend):
    """Reinhard et al. 2002, equations 5 to 9: eight scales, phi = 8, an edge above 0.05."""
    rng = np.random.default_rng(4)
    light = np.exp(rng.normal(0, 0.6, (50, 60))) * np.where(np.arange(60) < 25, 1, 30)
    scaled = light * 0.18 / np.exp(np.mean(np.log(light)))
    scales = [scipy.ndimage.gaussian_filter(scaled, 0.35 * 1.6**n) for n in range(9)]
    around, going = scales[0].copy(), np.ones(light.shape, bool)
    for n, (centre, wider) in enumerate(pairwise(scales)):
        level = 2**8 * 0.18 / (1.6**n) ** 2
        going &= np.abs((centre - wider) / (level + centre)) < 0.05
        around[going] = wider[going]
    want = np.minimum(scaled / (1 + around), 1)
    got = cvkern.tone_map(light, "reinhard_local")
    assert 0.1 < going.mean() < 0.9
    # In float32 a few pixels may fall on the other side of 0.05.
    assert (np.abs(got / want - 1) < 1e-4).mean() > 0.998
