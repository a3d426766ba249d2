"""The CUDA kernels of raw pictures compile, though they are made when they are first used."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

import cvkern
import cvkern.kernels.warp as kernels
from cvkern.kernels.warp.raw import bands, exposures, fusion, tone
from cvkern.kernels.warp.raw.demosaicing import _tiles_cuda, linear, planes, residual
from cvkern.raw.mosaics import red_place

MADE = {
    "differences": lambda: residual._differences,
    "green": lambda: residual._green,
    "chroma": lambda: residual._chroma,
    "linear u8": lambda: linear._kernels(wp.uint8, 1),
    "linear f32": lambda: linear._kernels(wp.float32, 0),
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


@pytest.mark.parametrize("pattern", ["RGGB", "GBRG"])
@pytest.mark.parametrize("shape", [(67, 90), (2, 3), (16, 64)])
def test_tiles_have_the_bits_of_rows(shape, pattern):
    """The tiles of CUDA compile for the CPU too, where one thread takes them all."""
    raw = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    want = cvkern.demosaic(raw, pattern, "menon")
    tiles = _tiles_cuda.kernels(wp.uint8)
    samples = wp.array(raw, device="cpu")
    beyond = tuple(n + 2 * _tiles_cuda.AROUND for n in shape)
    green, levels = (wp.zeros(beyond, dtype=t, device="cpu") for t in (wp.float32, wp.uint8))
    found = wp.zeros((*shape, 3), dtype=wp.uint8, device="cpu")
    place = red_place(pattern)
    wp.launch(tiles.green, 1, inputs=[samples, *place, green, levels], device="cpu")
    wp.launch(tiles.colour, 1, inputs=[samples, *place, green, levels, found], device="cpu")
    np.testing.assert_array_equal(found.numpy(), want)


@pytest.mark.parametrize("kernel", [0, 1])
def test_tiles_compile_for_hopper(kernel, tmp_path):
    kernels.start("cpu", None)
    module = _tiles_cuda.kernels(wp.uint16)[kernel].module
    (ptx,) = wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=True)
    assert "fma.rn.f32" not in Path(ptx).read_text()
