"""The CUDA kernels of raw pictures, and of bytes of sRGB, compile.

They are made when they are first used.
"""

from pathlib import Path

import pytest
import warp as wp

import cvkern.kernels.warp as kernels
from cvkern.kernels.warp.color import _contrast_cuda, _spaces_cuda
from cvkern.kernels.warp.raw import (
    _bands_cuda,
    _fusion_cuda,
    _grids_cuda,
    _tone_cuda,
    exposures,
    tone,
)
from cvkern.kernels.warp.raw.demosaicing import (
    _linear_cuda,
    _menon_cuda,
    _residual_cuda,
    planes,
    residual,
)

MADE = {
    "differences": lambda: _residual_cuda.line_differences,
    "cells": lambda: _residual_cuda.cell_windows(0, 1),
    "means": lambda: _residual_cuda.mean_windows,
    "green": lambda: _residual_cuda.green_strips,
    "chroma": lambda: residual._chroma.cuda(),
    "linear u8": lambda: _linear_cuda.kernel(wp.uint8, 0, 1, 1),
    "linear f32": lambda: _linear_cuda.kernel(wp.float32, 1, 1, 0),
    "menon": lambda: _menon_cuda.kernel(wp.uint16, 0, 0),
    "extend u16": lambda: planes._extend(wp.uint16).cuda(),
    "join u8": lambda: planes._join(wp.uint8).cuda(),
    "weigh u8": lambda: _fusion_cuda.kernels(wp.uint8, 3).weigh,
    "begin u8": lambda: _fusion_cuda.kernels(wp.uint8, 3).quick,
    "begin f32": lambda: _fusion_cuda.kernels(wp.float32, 1).begin,
    "blend": lambda: _fusion_cuda.kernels(wp.float32, 3).blend,
    "blend rest": lambda: _fusion_cuda.kernels(wp.float32, 3).rest,
    "finish u8": lambda: _fusion_cuda.kernels(wp.uint8, 3).finish,
    "begin": lambda: _bands_cuda.begin_strips,
    "reduce": lambda: _bands_cuda.reduce_strips,
    "reduce rest": lambda: _bands_cuda.reduce_rest,
    "collapse rest": lambda: _bands_cuda.collapse_rest,
    "collapse": lambda: _bands_cuda.collapse_four,
    "bytes": lambda: _spaces_cuda.encode_four,
    "levels u8": lambda: _contrast_cuda._count_levels(wp.uint8),
    "levels u16": lambda: _contrast_cuda._count_levels(wp.uint16),
    "values": lambda: _contrast_cuda.count_bins,
    "survey": lambda: _tone_cuda.survey_four,
    "show": lambda: _tone_cuda.show_four,
    "luminance": lambda: tone._luminance.cuda(),
    "fill": lambda: _grids_cuda.fill_cells,
    "read": lambda: _grids_cuda.read_four,
}
# Their sums of integers are exact, fused or not, and their quotients are corrected.
EXACT = {"linear u8", "menon", "weigh u8"}


def test_merging_compiles_for_hopper(tmp_path):
    """Its powers and logarithms are CUDA's own, and fuse."""
    kernels.start("cpu", None)
    kernel = exposures._kernel(wp.uint8)
    (ptx,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path, use_ptx=True)
    assert ".target sm_90" in Path(ptx).read_text()


@pytest.mark.parametrize("name", MADE)
def test_compiles_for_hopper(name, tmp_path):
    kernels.start("cpu", None)
    kernel = MADE[name]()
    (ptx,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path, use_ptx=True)
    assert name in EXACT or "fma.rn.f32" not in Path(ptx).read_text()
