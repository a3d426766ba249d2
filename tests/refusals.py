"""Tests of errors: the whole message is compared; `no_kernel_runs` checks that no kernel ran."""

import numpy as np
import pytest

import cvkern

FLAT, DEEP = np.zeros((4, 5)), np.zeros((4, 5, 3))
HUGE = np.broadcast_to(np.uint8(0), (2**15, 2**15))

# Functions of an image, by the shapes they take.
PHOTOGRAPHS = ["sobel", "scharr", "prewitt", "gradient", "canny", "subpixel_edges"]
FLAT_OR_DEEP = ["gaussian", "box", "median"]
FILTERS = {name: getattr(cvkern, name) for name in FLAT_OR_DEEP}
FILTERS["correlate_separable"] = lambda x, **options: cvkern.correlate_separable(x, [1], **options)
EVERY = {**FILTERS, **{name: getattr(cvkern, name) for name in PHOTOGRAPHS}}


def refused(error, message, function, *args, **options):
    with pytest.raises(error) as info:
        function(*args, **options)
    assert str(info.value) == message
