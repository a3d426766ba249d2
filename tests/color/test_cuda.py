"""Colour on a GPU: the bits of the CPU."""

import numpy as np
import pytest

import cvkern
from cvkern.color.constancy import METHODS
from tests.on_cuda import assert_equal_bits, on_gpu, reference

pytestmark = pytest.mark.usefixtures("gpu")

RNG = np.random.default_rng(9)
IMAGE = RNG.random((123, 171, 3)).astype(np.float32)


def test_the_light_is_that_of_the_cpu(backend):
    large = np.kron(IMAGE, np.ones((6, 5, 1), np.float32))
    for method in METHODS:
        for image in (IMAGE * 900, np.uint16(IMAGE * 60000), large):

            def call(x, method=method):
                return cvkern.estimate_illuminant(x, method)

            assert_equal_bits(on_gpu(call, image, backend), reference(call, image))


def test_bytes_are_those_of_the_cpu(backend):
    for image in (IMAGE, IMAGE * 1.3 - 0.1):

        def call(x):
            return cvkern.convert_color(x, "rgb", "srgb", dtype=np.uint8)

        assert_equal_bits(on_gpu(call, image, backend), reference(call, image))


def test_contrast_is_that_of_the_cpu(backend):
    for call in (cvkern.equalize_hist, cvkern.equalize_adapthist):
        for image in (IMAGE, np.uint8(IMAGE * 255)):
            assert_equal_bits(on_gpu(call, image, backend), reference(call, image))


def test_retinex_is_near_that_of_the_cpu(backend):
    """To the tolerance of the solver, 1e-5 of logarithms of about 1."""

    def call(x):
        return cvkern.retinex(x, method="gradients")

    got, want = on_gpu(call, IMAGE, backend), reference(call, IMAGE)
    np.testing.assert_allclose(got, want, atol=1e-3)
