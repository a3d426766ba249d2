"""How errors are tested: the whole message, and that no kernel ran before it."""

import numpy as np
import pytest
from calls import primitives

import cvkern

FLAT, DEEP = np.zeros((4, 5)), np.zeros((4, 5, 3))
HUGE = np.broadcast_to(np.uint8(0), (2**15, 2**15))

# Functions of an image, by the ranks they take.
FLAT_ONLY = ["sobel", "scharr", "gradient", "canny", "subpixel_edges"]
FLAT_OR_DEEP = ["gaussian", "box", "median"]
FILTERS = {name: getattr(cvkern, name) for name in FLAT_OR_DEEP}
FILTERS["correlate_separable"] = lambda x, **options: cvkern.correlate_separable(x, [1], **options)
EVERY = {**FILTERS, **{name: getattr(cvkern, name) for name in FLAT_ONLY}}


@pytest.fixture(autouse=True)
def no_kernel_runs(monkeypatch):
    """Checks are written once, above the kernel sets: one set shows that they come first."""

    def launched(*args, **options):
        raise AssertionError("a kernel was launched")

    for module, name, _ in primitives("warp"):
        monkeypatch.setattr(module, name, launched)
    with cvkern.use(backend="warp", device="cpu"):
        for name in EVERY:
            with pytest.raises(AssertionError, match="a kernel was launched"):
                EVERY[name](FLAT)  # or the tests below would show nothing
        yield


def refused(error, message, function, *args, **options):
    with pytest.raises(error) as info:
        function(*args, **options)
    assert str(info.value) == message
