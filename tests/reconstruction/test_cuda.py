"""Bundle adjustment on CUDA: no fused products, and the bits of the CPU."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.reconstruction import scenes, test_primitives


def test_compiles_without_fused_products(tmp_path):
    import cvkern.kernels.warp as kernel_set
    from cvkern.kernels.warp.reconstruction import _condensing_cuda, adjustment

    kernel_set.start("cpu", None)
    modules = {adjustment: "_linearise", _condensing_cuda: "_fill_blocks"}
    for module, name in modules.items():
        (ptx,) = wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=True)
        code = Path(ptx).read_text()
        assert ".target sm_90" in code
        assert name in code
        assert "fma.rn.f" not in code


def test_blocks_of_cuda_have_the_bits_of_the_cpu(all_kernels, monkeypatch):
    """Its kernels run on the CPU too: the order of their sums is that of the others."""
    from cvkern.kernels.warp.reconstruction import _condensing_cuda, adjustment

    kernels = all_kernels[0]
    given = test_primitives.bundle(behind=True)
    expected = test_primitives.step(kernels, *given, 9, 1e-3)[2]

    def condense(slopes, sightings, eliminated, blocks, condensed):
        seen = adjustment.struct_of(adjustment.Seen, sightings[1:])
        _condensing_cuda.condense(slopes, seen, eliminated, blocks, condensed)

    monkeypatch.setattr(adjustment, "condense", condense)
    found = test_primitives.step(kernels, *given, 9, 1e-3)[2]
    for one, other in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("backend", KERNEL_SETS)
def test_bits_are_those_of_the_cpu(gpu, backend):
    scene = scenes.make(count=5, points=60, noise=0.5, outliers=0.1)
    given = scene.poses, scene.camera, scene.points, scene.tracks, scene.places
    expected = cvkern.adjust_bundle(*given, refine="all", loss="cauchy")
    with cvkern.use(backend=backend, device="cuda"):
        found = cvkern.adjust_bundle(*given, refine="all", loss="cauchy")
    # Taichi's float64 is not IEEE's on CUDA: steps agree to rounding, and end alike.
    rounding = 1e-6 if backend == "taichi" else 0
    np.testing.assert_allclose(found.points, expected.points, rtol=rounding, atol=rounding)
    np.testing.assert_allclose(found.poses, expected.poses, rtol=rounding, atol=rounding)
