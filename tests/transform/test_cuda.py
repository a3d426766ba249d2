"""Transforms on CUDA: the kernels that are made on use compile, and give the CPU's bits."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.calls import blobs, noise
from tests.on_cuda import assert_equal_bits, on_gpu, reference
from tests.test_cuda_source import joined

MATRIX = np.array([[0.9, 0.2, 3.0], [-0.1, 1.1, -2.0], [1e-3, -2e-3, 1.0]])


def kernels():
    from cvkern.kernels.warp.transform import projective, resampling, sampling

    for scalar in (wp.uint8, wp.float32):
        for result in (wp.uint8, wp.float32):
            yield resampling.resample_kernel(scalar, result)
            for order in (0, 1, 3):
                yield sampling.remap_kernel(scalar, result, order)
                yield projective.warp_kernel(scalar, result, order)
    for order in (0, 1, 3):
        yield sampling.backward_kernel(order)
    for channels in projective.FEW:
        yield projective.warp_kernel_cuda(channels)


def test_compiles_without_fused_products(tmp_path):
    import cvkern.kernels.warp as kernel_set

    kernel_set.start("cpu", None)
    made = list(kernels())
    entries = []
    for module, _held in joined(made, "transform_for_hopper"):
        (ptx,) = wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=True)
        before, *parts = Path(ptx).read_text().split(".visible .entry ")
        assert ".target sm_90" in before
        assert "fma.rn" not in before
        entries += parts
    assert len(entries) == len(made)
    for code in entries:
        name = code.partition("(")[0]
        if "backward" in name:
            continue
        assert "fma.rn.f32" not in code
        # Divisions in float64 that are written out have five; all others are one instruction.
        assert code.count("fma.rn.f64") == 5 * code.count("rcp.approx.ftz.f64")


CALLS = {
    "remap": lambda x: cvkern.remap(x, np.mgrid[:30, :40] * np.float32(1.37), 3, mode="reflect"),
    "warp_perspective": lambda x: cvkern.warp_perspective(x, MATRIX),
    "bytes": lambda x: cvkern.warp_perspective(x, MATRIX, dtype=np.uint8),
    "nearest": lambda x: cvkern.warp_perspective(x, MATRIX, order=0),
    "resize": lambda x: cvkern.resize(x, (23, 31)),
    "area": lambda x: cvkern.resize(x, (23, 31), method="area", dtype=np.uint8),
    "rotate": lambda x: cvkern.rotate(x, 33, resize=True),
    "pyramid": lambda x: tuple(cvkern.pyramid_laplacian(x, 2)),
}


@pytest.mark.parametrize("backend", KERNEL_SETS)
@pytest.mark.parametrize("name", CALLS)
def test_bits_are_those_of_the_cpu(gpu, name, backend):
    for image in (blobs(61, 70), noise(61, 70)):
        assert_equal_bits(on_gpu(CALLS[name], image, backend), reference(CALLS[name], image))


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("mode", ["constant", "mirror"])
@pytest.mark.parametrize("shape", [(61, 70), (61, 72), (300, 516), (299, 515), (3, 16), (2, 9)])
def test_bytes_are_those_of_the_cpu(gpu, channels, mode, shape):
    height, width = shape
    image = noise(height, width * channels, dtype="uint8").reshape(height, width, channels)

    def call(image):
        return cvkern.warp_perspective(
            image, MATRIX, channel_axis=-1, mode=mode, cval=7.6, dtype=np.uint8
        )

    assert_equal_bits(on_gpu(call, image, "warp"), reference(call, image))


@pytest.mark.parametrize("matrix", [[[0.5, -0.9, 300], [0.8, 0.6, -20], [1e-4, 2e-4, 1.1]],
                                    [[3, 0, 0], [0, 3, 0], [0, 0, 3]],
                                    [[1, 0, 0], [0, 1, 0], [-4e-3, 0, 1]]])  # fmt: skip
@pytest.mark.parametrize("shape", [(2, 301, 404), (3, 300, 403)])
def test_planes_of_bytes_are_those_of_the_cpu(gpu, shape, matrix):
    """Planes that begin at any byte, and a horizon in the picture."""
    image = noise(shape[0], shape[1] * shape[2], dtype="uint8").reshape(shape)

    def call(image):
        return cvkern.warp_perspective(image, matrix, (290, 420), channel_axis=0, dtype=np.uint8)

    assert_equal_bits(on_gpu(call, image, "warp"), reference(call, image))


@pytest.mark.parametrize("backend", KERNEL_SETS)
def test_gradients_are_those_of_the_cpu(gpu, backend):
    def call(image):
        where = np.mgrid[:30, :40] * np.float32(1.37)
        return cvkern.remap_backward(noise(30, 40), image, where, 3, mode="mirror")

    image = noise(41, 50)
    for a, b in zip(on_gpu(call, image, backend), reference(call, image), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-5)  # sums of float64 in another order
