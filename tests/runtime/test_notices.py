"""Results that are empty because of a setting: a warning on the caller's line says why."""

import re
import warnings

import numpy as np
import pytest

import cvkern
from tests.calls import blobs

PICTURE = np.kron(np.indices((9, 12)).sum(0) % 2, np.ones((9, 9)))
PICTURE = (200 * cvkern.gaussian(PICTURE, 1.0) + 20).astype(np.uint8)
LASER = np.zeros((40, 50), np.uint8)
LASER[20:23] = np.array([[60], [200], [60]])
GRAY = cvkern.gray_code_patterns((16, 31))
SHIFTED = cvkern.phase_shift_patterns((16, 31))
LIGHTS = np.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8], [-0.6, 0, 0.8]])
LIT = cvkern.lambertian(np.full((4, 5, 3), [0.0, 0.28, 0.96]), LIGHTS)
# Calls with a setting that finds nothing or something, and what is said of nothing.
CALLS = {
    "sift": (lambda n: cvkern.sift(PICTURE // n), 24, 1,
             "no keypoint was found: the largest value is 9, and white is 255: give data_range"),
    "orb": (lambda n: cvkern.orb(PICTURE // n), 24, 1,
            "no keypoint was found: the largest value is 9, and white is 255: give data_range"),
    "laser": (lambda n: cvkern.detect_laser_lines(LASER, method="peak", threshold=n), 201, 199,
              "no line was found: the strongest is 200, below threshold 201"),
    "gray": (lambda n: cvkern.decode_gray_code(GRAY, (16, 31), margin=n), 255, 254,
             "no code was found: a pattern and its inverse differ by at most 255, and margin is"),
    "phase": (lambda n: cvkern.decode_phase_shift(SHIFTED, (16, 31), threshold=n), 130, 120,
              "no phase was found: the largest modulation is 127.5, below threshold 130"),
    "photometric": (lambda n: cvkern.photometric_stereo(LIT, LIGHTS, saturation=n), 0.1, 0.99,
                    "no normal was found: all values are at least 0.768"),
}  # fmt: skip


@pytest.mark.parametrize("name", CALLS)
def test_nothing_is_not_found_in_silence(backend, name):
    call, nothing, something, said = CALLS[name]
    with pytest.warns(UserWarning, match=re.escape(said)) as caught:
        call(nothing)
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        call(something)


def test_a_decorator_of_another_module_is_not_the_caller():
    dark = (PICTURE / 10000).astype(np.float32)
    with pytest.warns(UserWarning, match="no keypoint was found") as caught:
        cvkern.match_photographs(dark, dark, data_range=1.0)
    assert {warning.filename for warning in caught} == {__file__}


def test_thresholds_of_opencv_are_refused():
    """They are in values of 8 bits, which here would find nothing."""
    with pytest.raises(ValueError, match="fast_threshold must be at most 1, a part of white"):
        cvkern.orb(blobs(60, 70), fast_threshold=20)
    with pytest.raises(ValueError, match="contrast_threshold must be at most 1, a part of white"):
        cvkern.sift(blobs(60, 70), contrast_threshold=4)


def test_an_ignored_contrast_is_refused():
    with pytest.raises(ValueError, match="contrast must be None without white and black, got 5"):
        cvkern.decode_gray_code(GRAY, (16, 31), contrast=5)
