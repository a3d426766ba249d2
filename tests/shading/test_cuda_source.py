"""The CUDA kernels of shading compile; where bits are promised, none has a fused multiply-add."""

from pathlib import Path

import pytest
import warp as wp

import cvkern.kernels.warp as kernels
from cvkern.kernels.warp.shading import meshes, photometry, recovery, rendering
from cvkern.kernels.warp.shading.integration import cosines, equations, multigrid


@pytest.mark.parametrize(
    "module", [rendering, meshes, photometry, recovery, equations, multigrid, cosines]
)
def test_compiles_for_hopper(module, tmp_path):
    kernels.start("cpu", None)
    (ptx,) = wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=True)
    text = Path(ptx).read_text()
    assert ".visible .entry" in text
    assert "fma.rn.f32" not in text
