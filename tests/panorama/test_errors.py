"""Every error of panoramas, by the whole message."""

import numpy as np
import pytest

import cvkern
from tests.refusals import refused

IMAGE = np.zeros((4, 5), np.uint8)

REFUSED = [
    (ValueError, "images must not be empty, got none", ([],), {}),
    (ValueError, "images must be a sequence of arrays, got one array", (IMAGE,), {}),
    (ValueError, "images[1] must be 2-D or 3-D, got shape (3,)", ([IMAGE, np.zeros(3)],), {}),
    (ValueError, "images[0] must have 1, 3 or 4 channels, got shape (4, 5, 2)",
     ([np.zeros((4, 5, 2))],), {}),
    (ValueError, "images[0] must not be empty, got shape (0, 5)", ([np.zeros((0, 5))],), {}),
    (TypeError, "images[0] must hold real numbers, got dtype complex128",
     ([np.zeros((4, 5), complex)],), {}),
    (ValueError, "data_range must be > 0, got 0", ([IMAGE],), {"data_range": 0}),
]  # fmt: skip
OPTIONS = [
    (ValueError, "images must be of one dtype, got uint16, uint8",
     ([IMAGE, IMAGE.astype(np.uint16)],), {}),
    (ValueError, "surface must be one of ('auto', 'plane', 'cylinder', 'sphere'), got 'cube'",
     ([IMAGE],), {"surface": "cube"}),
    (ValueError, "scale must be > 0, got 0", ([IMAGE],), {"scale": 0}),
    (ValueError, "scale must be >= 1e-06 and finite, got 1e-320", ([IMAGE],), {"scale": 1e-320}),
    (ValueError, "bands must be in [0, 8], got 9", ([IMAGE],), {"bands": 9}),
    (TypeError, "crop must be True or False, got 'yes'", ([IMAGE],), {"crop": "yes"}),
    (ValueError, "max_pixels must be in [1, 536870912], got 0", ([IMAGE],), {"max_pixels": 0}),
    (ValueError, "focal_lengths must have shape (1,), got (2,)", ([IMAGE],),
     {"focal_lengths": [1, 2]}),
    (ValueError, "focal_lengths must be > 0 and finite, or NaN, got others", ([IMAGE],),
     {"focal_lengths": [-1.0]}),
    (ValueError, "names must be as many as the 1 images, got 2", ([IMAGE],),
     {"names": ["a.png", "b.png"]}),
    (TypeError, "names must be a sequence of strings, got 'a'", ([IMAGE],), {"names": "a"}),
    (TypeError, "names must be a sequence of strings, got [3]", ([IMAGE],), {"names": [3]}),
    (TypeError, "names must be a sequence of strings, got 3", ([IMAGE],), {"names": 3}),
]  # fmt: skip
PAIRS = [
    (ValueError, "image1 must have 3 or 4 channels, got shape (4, 5, 2)",
     (IMAGE, np.zeros((4, 5, 2))), {}),
    (ValueError, "image0 must be 2-D or 3-D, got shape (3,)", (np.zeros(3), IMAGE), {}),
    (ValueError, "threshold must be > 0, got 0", (IMAGE, IMAGE, 0), {}),
    (ValueError, "max_keypoints must be in [1, 1048576], got 0", (IMAGE, IMAGE),
     {"max_keypoints": 0}),
    (ValueError, "max_ratio must be in (0, 1], got 2", (IMAGE, IMAGE), {"max_ratio": 2}),
    (ValueError, "data_range must be > 0, got 0", (IMAGE, IMAGE), {"data_range": 0}),
    (ValueError, "seed must be in [0, 2147483647], got -1", (IMAGE, IMAGE), {"seed": -1}),
]  # fmt: skip


@pytest.mark.parametrize(("error", "message", "args", "options"), REFUSED)
def test_refusals(no_kernel_runs, error, message, args, options):
    refused(error, message, cvkern.recognize_panoramas, *args, **options)
    refused(error, message, cvkern.stitch, *args, **options)


@pytest.mark.parametrize(("error", "message", "args", "options"), OPTIONS)
def test_refusals_of_options(no_kernel_runs, error, message, args, options):
    refused(error, message, cvkern.stitch, *args, **options)


@pytest.mark.parametrize(("error", "message", "args", "options"), PAIRS)
def test_refusals_of_pairs(no_kernel_runs, error, message, args, options):
    refused(error, message, cvkern.match_photographs, *args, **options)
