"""The CUDA kernel that is made for a size of patches compiles, for tensor cores."""

from pathlib import Path

import pytest
import warp as wp

import cvkern.kernels.warp as kernels
from cvkern.kernels.warp.recognition import _words_cuda


@pytest.mark.parametrize(("words", "most"), [(64, 5), (160, 8)])
def test_compiles_for_hopper(words, most, tmp_path):
    kernels.start("cpu", None)
    module = _words_cuda.match(words, most).module
    (ptx,) = wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=True)
    text = Path(ptx).read_text()
    assert "mma.sync.aligned.m16n8k32.row.col.s32.s8.s8.s32" in text
    assert "fma.rn.f" not in text
