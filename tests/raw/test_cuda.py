"""Raw pictures on a GPU: the bits of the CPU, and the caller's arrays."""

import numpy as np
import pytest

import cvkern
from tests.on_cuda import (
    LIBRARIES,
    assert_equal_bits,
    device_of,
    give,
    on_gpu,
    reference,
    take,
)

pytestmark = pytest.mark.usefixtures("gpu")

RNG = np.random.default_rng(8)
RADIANCE = np.exp(RNG.normal(0, 2, (150, 211, 3))).astype(np.float32)
FRAMES = RNG.integers(0, 256, (3, 77, 131, 3)).astype(np.uint8)


@pytest.mark.parametrize("method", ["reinhard", "reinhard_local", "bilateral", "local_laplacian"])
def test_tones_are_those_of_the_cpu(method, backend):
    for image in (RADIANCE, RADIANCE[..., 0], RADIANCE[:3, :2], RADIANCE[:1]):

        def call(x):
            return cvkern.tone_map(x, method)

        assert_equal_bits(on_gpu(call, image, backend), reference(call, image))


def test_fusion_is_that_of_the_cpu(backend):
    for frames in (FRAMES, FRAMES[..., 0], FRAMES[:, :1], np.float32(FRAMES / 255)):
        for contrast in (1, 0.5):

            def call(x, contrast=contrast):
                return cvkern.fuse_exposures(x, contrast=contrast)

            assert_equal_bits(on_gpu(call, frames, backend), reference(call, frames))


def test_alignment_is_that_of_the_cpu(backend):
    for frames in (FRAMES, FRAMES[..., 0], np.float32(FRAMES) / 7):

        def call(x):
            return cvkern.align_exposures(x, reach=8)

        assert_equal_bits(on_gpu(call, frames, backend), reference(call, frames))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("method", ["bilinear", "malvar", "menon", "residual"])
def test_demosaicing_is_that_of_the_cpu(method, dtype, backend):
    for shape in ((2, 3), (97, 130), (300, 1029)):
        raw = RNG.integers(0, 255, shape).astype(dtype)
        for pattern in ("RGGB", "GBRG"):

            def call(x, pattern=pattern):
                return cvkern.demosaic(x, pattern, method)

            assert_equal_bits(on_gpu(call, raw, backend), reference(call, raw))


@pytest.mark.parametrize("library", LIBRARIES)
def test_the_callers_arrays(library):
    for call, image in (
        (cvkern.fuse_exposures, FRAMES),
        (lambda x: cvkern.tone_map(x, "local_laplacian"), RADIANCE),
        (cvkern.demosaic, FRAMES[0, ..., 0]),
    ):
        given = give(library, np.ascontiguousarray(image))
        got = call(given)
        assert type(got) is type(given)
        assert device_of(got) == device_of(given)
        np.testing.assert_array_equal(take(got), call(np.ascontiguousarray(image)))
