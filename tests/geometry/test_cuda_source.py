"""The CUDA kernels of cameras compile, though they are made when they are first used."""

from pathlib import Path

import pytest
import warp as wp

import cvkern.kernels.warp as kernels
from cvkern.kernels.warp.geometry.cameras import undistortion


@pytest.mark.parametrize(
    ("scalar", "channels"), [(wp.uint8, 1), (wp.uint8, 3), (wp.uint8, 4), (wp.float32, 3)]
)
def test_compiles_for_hopper(scalar, channels, tmp_path):
    kernels.start("cpu", None)
    kernel = undistortion.sample_parts_cuda(scalar, channels)
    (ptx,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path, use_ptx=True)
    assert "fma.rn.f32" not in Path(ptx).read_text()
