"""The CUDA kernels of structured light compile, though they are made when they are first used."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import warp as wp

import cvkern.kernels.warp as kernels
from cvkern.kernels.warp.structured_light import gray_code, laser, phase, triangulation


def made(scalar) -> Iterator[Any]:
    """Yield the kernels for frames of one dtype."""
    yield gray_code._decode_cuda(scalar)
    if scalar is wp.uint8:
        yield gray_code._decode_bytes_cuda()
    yield gray_code._accept_cuda(scalar)
    yield gray_code._spreads(scalar)
    yield phase._decode_cuda(scalar)
    lines = laser._kernels(scalar)
    yield from (lines.peaks, lines.centroids, lines.ridges)
    yield laser._find_in_columns_cuda(scalar)
    yield laser._find_in_rows_cuda(scalar)
    yield laser._find_ridges_cuda(scalar)


@pytest.mark.parametrize("scalar", [wp.uint8, wp.uint16, wp.float32])
def test_compiles_for_hopper(scalar, tmp_path):
    kernels.start("cpu", None)
    for n, kernel in enumerate(made(scalar)):
        folder = tmp_path / f"{n}"
        (ptx,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=folder, use_ptx=True)
        # Written by hand, one makes a remainder that is exact.
        text = re.sub(
            "// begin inline asm.*?// end inline asm", "", Path(ptx).read_text(), flags=re.S
        )
        assert "fma.rn.f32" not in text, kernel.key


@pytest.mark.parametrize("axis", [0, 1])
def test_triangulation_compiles_for_hopper(axis, tmp_path):
    kernels.start("cpu", None)
    kernel = triangulation._intersect_cuda(axis)
    (ptx,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path, use_ptx=True)
    assert Path(ptx).stat().st_size > 0
