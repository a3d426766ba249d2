"""The CUDA kernels of shading compile; where bits are promised, none has a fused multiply-add."""

from pathlib import Path

import pytest
import warp as wp

import cvkern.kernels.warp as kernels
from cvkern.kernels.warp.shading import (
    _photometry_cuda,
    _robust_cuda,
    meshes,
    photometry,
    recovery,
    rendering,
)
from cvkern.kernels.warp.shading.integration import _rows_cuda, cosines, equations, multigrid


@pytest.mark.parametrize(
    "module", [rendering, meshes, photometry, recovery, equations, multigrid, cosines]
)
def test_compiles_for_hopper(module, tmp_path):
    kernels.start("cpu", None)
    (ptx,) = wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=True)
    text = Path(ptx).read_text()
    assert ".visible .entry" in text
    assert "fma.rn.f32" not in text


@pytest.mark.parametrize("name", ["solve", "rank", "weigh", "rows"])
def test_native_code_compiles_for_hopper(name, tmp_path):
    """To machine code of the GPU with the least shared memory, too: there is enough."""
    kernels.start("cpu", None)
    made = {
        "solve": _photometry_cuda.kernel(20),
        "rank": _robust_cuda.rank_kept,
        "weigh": _robust_cuda.weigh_kept,
        "rows": _rows_cuda.solve_row,
    }
    module = made[name].module
    (ptx,) = wp.compile_aot_module(module, arch=90, module_dir=tmp_path / "ptx", use_ptx=True)
    # Robust sums are float32 that are corrected; they may fuse.
    assert name == "weigh" or "fma.rn.f" not in Path(ptx).read_text()
    (cubin,) = wp.compile_aot_module(module, arch=75, module_dir=tmp_path / "bin", use_ptx=False)
    assert Path(cubin).stat().st_size > 0
