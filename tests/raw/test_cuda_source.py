"""The CUDA kernels of raw pictures compile, though they are made when they are first used."""

from pathlib import Path

import pytest
import warp as wp

import cvkern.kernels.warp as kernels
from cvkern.kernels.warp.raw import bands, exposures, fusion, tone
from cvkern.kernels.warp.raw.demosaicing import linear, menon, planes, residual

MADE = {
    "menon": lambda: menon._menon,
    "differences": lambda: residual._differences,
    "green": lambda: residual._green,
    "chroma": lambda: residual._chroma,
    "linear u8": lambda: linear._kernels(wp.uint8),
    "linear f32": lambda: linear._kernels(wp.float32),
    "extend u16": lambda: planes._extend(wp.uint16),
    "join u8": lambda: planes._join(wp.uint8),
    "weigh u8": lambda: fusion._weigh(wp.uint8, 3),
    "begin f32": lambda: fusion._begin(wp.float32, 1),
    "blend": lambda: fusion._blend(3),
    "finish u8": lambda: fusion._finish(wp.uint8, 3),
    "begin": lambda: bands._begin,
    "reduce": lambda: bands._reduce,
    "collapse": lambda: bands._collapse,
    "luminance": lambda: tone._luminance,
    "show": lambda: tone._show,
}


def test_merging_compiles_for_hopper(tmp_path):
    """Its powers and logarithms are CUDA's own, and fuse."""
    kernels.start("cpu", None)
    kernel = exposures._kernel(wp.uint8)
    (ptx,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path, use_ptx=True)
    assert ".target sm_90" in Path(ptx).read_text()


@pytest.mark.parametrize("name", MADE)
def test_compiles_for_hopper(name, tmp_path):
    kernels.start("cpu", None)
    kernel = MADE[name]().cuda()
    (ptx,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path, use_ptx=True)
    assert "fma.rn.f32" not in Path(ptx).read_text()
