"""What features refuse, by the whole message."""

import numpy as np
import pytest

import cvkern
from tests.refusals import refused

FOUND = cvkern.Features(*np.zeros((5, 1)))
IMAGE, BYTES = np.zeros((4, 5)), np.zeros((2, 4), np.uint8)

REFUSED = [
    (ValueError, "image must have 3 or 4 channels, got shape (4, 5, 2)", cvkern.sift,
     (np.zeros((4, 5, 2)),), {}),
    (ValueError, "mask must have shape (4, 5), got (5, 4)", cvkern.sift, (IMAGE,),
     {"mask": np.zeros((5, 4))}),
    (ValueError, "max_keypoints must be in [0, 67108864], got -1", cvkern.sift, (IMAGE, -1), {}),
    (ValueError, "sigma must be in (0.4, 4], got 0.3", cvkern.sift, (IMAGE,), {"sigma": 0.3}),
    (ValueError, "levels must be in [1, 8], got 0", cvkern.sift, (IMAGE,), {"levels": 0}),
    (ValueError, "data_range must be > 0, got 0", cvkern.sift, (IMAGE,), {"data_range": 0}),
    (ValueError, "contrast_threshold must be >= 0.0001 and finite, got 0", cvkern.sift, (IMAGE,),
     {"contrast_threshold": 0}),
    (ValueError, "max_ratio must be in (0, 1], got 0", cvkern.match_descriptors,
     (BYTES, BYTES, 0), {}),
    (TypeError, "b must be uint8, got float64", cvkern.match_descriptors,
     (BYTES, BYTES.astype(float)), {}),
    (TypeError, "b must be descriptors, got Features: take its descriptors",
     cvkern.match_descriptors, (BYTES, FOUND), {}),
    (ValueError, "b must have 4 bytes a row, got 3", cvkern.match_descriptors,
     (BYTES, BYTES[:, :3]), {}),
    (ValueError, "a must be 2-D, got shape (4,)", cvkern.match_descriptors,
     (BYTES[0], BYTES), {}),
    (ValueError, "metric must be one of ('euclidean', 'hamming'), got 'l1'",
     cvkern.match_descriptors, (BYTES, BYTES), {"metric": "l1"}),
    (ValueError, "pairs must be two different images of 2, got others", cvkern.match_images,
     ([BYTES, BYTES], [(0, 2)]), {}),
    (ValueError, "pairs must be two different images of 2, got others", cvkern.match_images,
     ([BYTES, BYTES], [(1, 1)]), {}),
]  # fmt: skip


@pytest.mark.parametrize(("error", "message", "function", "args", "options"), REFUSED)
def test_refusals(no_kernel_runs, error, message, function, args, options):
    refused(error, message, function, *args, **options)
