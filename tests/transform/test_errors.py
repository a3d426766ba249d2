"""What transforms refuse, by the whole message."""

import numpy as np
import pytest

import cvkern
from tests.refusals import refused

IMAGE, PLACE = np.zeros((4, 5)), np.zeros((2, 1, 1))

REFUSED = [
    (ValueError, "order must be one of (0, 1, 3), got 2", cvkern.remap, (IMAGE, PLACE, 2), {}),
    (ValueError, "order must be in [0, 3], got 4", cvkern.remap, (IMAGE, PLACE, 4), {}),
    (ValueError, "coordinates must have shape (2, H, W), got (3, 1, 1)", cvkern.remap,
     (IMAGE, np.zeros((3, 1, 1))), {}),
    (ValueError, "channel_axis must be the first or the last, got 1", cvkern.remap,
     (np.zeros((2, 2, 2)), PLACE), {"channel_axis": 1}),
    (TypeError, "dtype must be float32 or uint8, got int32", cvkern.remap, (IMAGE, PLACE),
     {"dtype": "int32"}),
    (ValueError, "grad must have shape (1, 1), got (2, 1)", cvkern.remap_backward,
     (np.zeros((2, 1)), IMAGE, PLACE), {}),
    (ValueError, "matrix must be (3, 3) finite numbers, got shape (2, 2)",
     cvkern.warp_perspective, (IMAGE, np.eye(2)), {}),
    (ValueError, "matrix must be invertible, got one that is not", cvkern.warp_perspective,
     (IMAGE, np.ones((3, 3))), {}),
    (ValueError, "shape must be a height and a width, got 1 numbers", cvkern.warp_perspective,
     (IMAGE, np.eye(3), (4,)), {}),
    (ValueError, "shape must be in [1, 65536], got 0", cvkern.resize, (IMAGE, (0, 3)), {}),
    (ValueError, "method must be one of ('linear', 'area'), got 'cubic'", cvkern.resize,
     (IMAGE, (2, 3)), {"method": "cubic"}),
    (ValueError, "center must be a row and a column, got 1 numbers", cvkern.rotate,
     (IMAGE, 3), {"center": (1,)}),
    (ValueError, "angle must be finite, got nan", cvkern.rotate, (IMAGE, np.nan), {}),
    (ValueError, "corners must be (4, 2) finite numbers, got shape (3, 2)",
     cvkern.rectify_plane, (IMAGE, np.zeros((3, 2)), (3, 3)), {}),
    *((ValueError,
       "corners must go round a quadrilateral without a dent, no three on a line, got others",
       cvkern.rectify_plane, (IMAGE, corners, (3, 3)), {})
      for corners in ([(0, 0), (0, 1), (0, 2), (3, 3)], [(0, 0), (3, 3), (0, 3), (3, 0)],
                      [(0, 0), (0, 3), (1, 1), (3, 0)])),
    (ValueError, "downscale must be > 1, got 1", cvkern.pyramid_gaussian, (IMAGE, 1, 1), {}),
    (ValueError, "max_layer must be in [-1, 65536], got -2", cvkern.pyramid_laplacian,
     (IMAGE, -2), {}),
]  # fmt: skip


@pytest.mark.parametrize(("error", "message", "function", "args", "options"), REFUSED)
def test_refusals(no_kernel_runs, error, message, function, args, options):
    refused(error, message, function, *args, **options)
