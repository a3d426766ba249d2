"""Phases without their jumps."""

import imageio.v3 as iio
import numpy as np
import pytest
import skimage.restoration

import cvkern
from tests.truth import truth

TURN = 2 * np.pi


def wrapped(phase):
    return np.angle(np.exp(1j * phase))


def turns_off(found, phase, mask):
    """Return by how many turns each pixel is off, but for those of the first one."""
    off = np.rint((found - phase)[mask] / TURN)
    return off - off[0]


def hill(height=70, width=90):
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    return 40 * np.exp(-2 * (x**2 + y**2)) + 5 * x


def test_smooth_phases_come_back(backend):
    phase = hill()
    found = cvkern.unwrap_phase(wrapped(phase))
    assert found.dtype == np.float32
    assert found[0, 0] == np.float32(wrapped(phase)[0, 0])
    shift = found[0, 0] - phase[0, 0]
    # Values up to 45, rounded to float32 twice.
    np.testing.assert_allclose(found, phase + shift, rtol=0, atol=2e-5)


def test_with_noise_as_scikit_image(backend):
    rng = np.random.default_rng(0)
    phase = hill() + rng.normal(0, 0.4, (70, 90))
    found = cvkern.unwrap_phase(wrapped(phase))
    theirs = skimage.restoration.unwrap_phase(wrapped(phase))
    everywhere = np.ones(phase.shape, bool)
    ours_wrong = np.mean(turns_off(found, phase, everywhere) != 0)
    assert ours_wrong <= max(0.002, np.mean(turns_off(theirs, phase, everywhere) != 0))


def test_regions_are_unwrapped_by_themselves(backend):
    phase = hill()
    mask = np.ones(phase.shape, np.uint8)
    mask[:, 40:44] = 0
    mask[30:33, :40] = 0
    found = cvkern.unwrap_phase(wrapped(phase), mask)
    np.testing.assert_array_equal(np.isnan(found), mask == 0)
    for region in (np.s_[:30, :40], np.s_[33:, :40], np.s_[:, 44:]):
        assert found[region][0, 0] == np.float32(wrapped(phase[region])[0, 0])
        assert not turns_off(found[region], phase[region], np.ones_like(phase[region], bool)).any()


def test_a_cut_is_gone_round(backend):
    """Where a slit tears the phase, the way round its end tells the turns."""
    phase = hill()
    seen = wrapped(phase)
    seen[20:50, 45] = np.random.default_rng(1).uniform(-np.pi, np.pi, 30)
    found = cvkern.unwrap_phase(seen)
    mask = np.ones(phase.shape, bool)
    mask[20:50, 45] = False
    assert not turns_off(found, phase, mask).any()


def test_one_pixel_and_none(backend):
    np.testing.assert_array_equal(cvkern.unwrap_phase([[9.0]]), np.array([[9.0]], np.float32))
    assert np.isnan(cvkern.unwrap_phase([[np.nan, np.inf]])).all()
    assert np.isnan(cvkern.unwrap_phase(np.ones((2, 3)), np.zeros((2, 3)))).all()


def test_a_real_scene(backend):
    """More neighbours are within half a turn than with scikit-image; only turns are added."""
    folder = truth("structured_light") / "three_phase_zebra"
    images = np.stack([iio.imread(path).astype(float) for path in sorted(folder.glob("*.png"))])
    if images.ndim == 4:
        images = images[..., :3].mean(axis=-1)
    a, b, c = images
    seen = np.arctan2(np.sqrt(3) * (a - c), 2 * b - a - c)
    mask = np.sqrt(3 * (a - c) ** 2 + (2 * b - a - c) ** 2) / 3 > 10
    found = cvkern.unwrap_phase(seen, mask).astype(float)
    theirs = np.asarray(skimage.restoration.unwrap_phase(np.ma.array(seen, mask=~mask)))

    def share(phase):
        near = [
            np.abs(np.diff(phase, axis=axis))[
                mask[1:] & mask[:-1] if axis == 0 else mask[:, 1:] & mask[:, :-1]
            ]
            for axis in (0, 1)
        ]
        return np.mean(np.concatenate(near) <= np.pi + 1e-5)

    assert share(found) > max(0.9996, share(theirs))
    turns = (found - seen)[mask] / TURN
    np.testing.assert_allclose(turns, np.rint(turns), rtol=0, atol=1e-5)  # float32 of up to 100


def test_errors(no_kernel_runs):
    with pytest.raises(ValueError, match=r"^phase must be 2-D, got shape \(3,\)$"):
        cvkern.unwrap_phase(np.zeros(3))
    message = r"^mask must have the shape of the phase, \(2, 2\), got \(3, 3\)$"
    with pytest.raises(ValueError, match=message):
        cvkern.unwrap_phase(np.eye(2), np.eye(3))
