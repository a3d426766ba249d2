"""The CUDA kernels compile: Warp brings the compiler, which needs no GPU."""

import importlib
import pkgutil
from pathlib import Path

import pytest
import warp as wp

import cvkern.kernels.warp as kernels

MODULES = [m.name for m in pkgutil.iter_modules(kernels.__path__) if m.name.endswith("_blocks")]


@pytest.mark.parametrize(
    "name", [*MODULES, "_circles_peaks", "_edges_points", "_lines_points", "_shapes_points"]
)
def test_compiles_for_hopper(name, tmp_path):
    kernels.start("cpu", None)
    module = importlib.import_module(f"{kernels.__name__}.{name}")
    (ptx,) = wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=True)
    code = Path(ptx).read_text()
    assert ".target sm_90" in code
    if name != "_edges_points":  # whose logarithm is CUDA's own
        assert "fma.rn.f32" not in code  # equal bits: no product is fused with a sum


@pytest.mark.parametrize("name", MODULES)
def test_blocks_are_numbered_along_one_axis(name):
    """Without grid strides Warp folds more than 2^24 threads into three dimensions."""
    text = (Path(kernels.__file__).parent / f"{name}.py").read_text()
    assert "blockIdx" not in text or "default_grid_stride" not in text
