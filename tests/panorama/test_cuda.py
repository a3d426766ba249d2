"""Panoramas on CUDA: the kernels that are made on use compile, and give the CPU's bits."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp
from skimage import data

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.on_cuda import LIBRARIES, give, take
from tests.panorama.scenes import through
from tests.panorama.test_stitching import SHAPE, VIEWS


def kernels():
    from cvkern.kernels.warp.panorama import blending, warping

    for scalar in (wp.uint8, wp.float32):
        yield warping.project_kernel(scalar)
        yield blending.finish_kernel(scalar)


def test_compiles_without_fused_products(tmp_path):
    import cvkern.kernels.warp as kernel_set

    kernel_set.start("cpu", None)
    for n, kernel in enumerate(kernels()):
        (ptx,) = wp.compile_aot_module(
            kernel.module, arch=90, module_dir=tmp_path / f"{n}", use_ptx=True
        )
        code = Path(ptx).read_text()
        assert ".target sm_90" in code
        assert "fma.rn.f" not in code


@pytest.mark.parametrize("backend", KERNEL_SETS)
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_bits_are_those_of_the_cpu(gpu, backend, dtype):
    sheet = [through(data.coffee(), matrix, SHAPE).astype(dtype) for matrix in VIEWS]
    (expected,) = cvkern.stitch(sheet, data_range=255)
    with cvkern.use(backend=backend, device="cuda"):
        (found,) = cvkern.stitch(sheet, data_range=255)
    np.testing.assert_array_equal(found.mask, expected.mask)
    # Taichi's float64 is not IEEE's on CUDA: robust fitting agrees to rounding there.
    rounding = 1e-7 if backend == "taichi" else 0
    np.testing.assert_allclose(found.matrices, expected.matrices, rtol=rounding, atol=rounding)
    # Places that are off by 1e-5 pixels, where neighbours differ by 100 at most. Of integers, a few
    # that lie half way are rounded to the other side.
    off = np.abs(found.image.astype(np.float64) - expected.image)
    most = (1e-3 if dtype == np.float32 else 1) if rounding else 0
    assert off.max() <= most
    assert dtype == np.float32 or (off > 0).mean() < 1e-5


@pytest.mark.parametrize("library", LIBRARIES)
def test_arrays_of_other_libraries(gpu, library):
    sheet = [through(data.coffee(), matrix, SHAPE) for matrix in VIEWS]
    (expected,) = cvkern.stitch(sheet, crop=True)
    (found,) = cvkern.stitch([give(library, image) for image in sheet], crop=True)
    np.testing.assert_array_equal(take(found.image), expected.image)
    assert take(found.mask).all()
