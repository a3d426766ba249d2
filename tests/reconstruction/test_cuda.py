"""Bundle adjustment on CUDA: no fused products, and the bits of the CPU."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.reconstruction import scenes


def test_compiles_without_fused_products(tmp_path):
    import cvkern.kernels.warp as kernel_set
    from cvkern.kernels.warp.reconstruction import adjustment

    kernel_set.start("cpu", None)
    (ptx,) = wp.compile_aot_module(adjustment, arch=90, module_dir=tmp_path, use_ptx=True)
    code = Path(ptx).read_text()
    assert ".target sm_90" in code
    assert "_condense" in code
    assert "fma.rn.f" not in code


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
