"""The CUDA kernels of radiance fields compile: Warp brings the compiler, which needs no GPU."""

import importlib
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import cvkern.kernels.warp as kernels


def compile_for_hopper(module, folder):
    (ptx,) = wp.compile_aot_module(module, arch=90, module_dir=folder, use_ptx=True)
    code = Path(ptx).read_text()
    assert ".target sm_90" in code
    return code


@pytest.fixture(scope="module", autouse=True)
def _started():
    kernels.start("cpu", None)


def load(name):
    return importlib.import_module(f"{kernels.__name__}.{name}")


@pytest.mark.parametrize(
    "name", ["radiance.march.steps", "radiance.march._steps_cuda", "radiance._rendering_cuda"]
)
def test_marching_meets_the_same_cells(name, tmp_path):
    """Which cells a ray meets is an integer: no product is fused with a sum."""
    code = compile_for_hopper(load(name), tmp_path)
    assert "div.rn.f32" in code  # not an approximate one
    assert "fma.rn.f32" not in code


def test_compositing_loads_one_number_at_a_time(tmp_path):
    """The arrays are the caller's, which may begin anywhere."""
    assert ".v2." not in compile_for_hopper(load("radiance._compositing_cuda"), tmp_path)


@pytest.mark.parametrize("transposed", [False, True])
@pytest.mark.parametrize(
    ("depth", "columns"), [(16, 64), (32, 64), (64, 16), (64, 64), (192, 48), (320, 64), (352, 64)]
)
def test_products_compile_for_hopper(depth, columns, transposed, tmp_path):
    kernel = load("radiance.fields.perceptron._layers_cuda").product(depth, columns, transposed)
    code = compile_for_hopper(kernel.module, tmp_path)
    # All products of a block of 16 samples are unrolled, for all or eight columns at a time.
    assert code.count("mma.sync.aligned.m16n8k16") == depth // 16 * columns // 8


@pytest.mark.parametrize(("depth", "columns"), [(16, 64), (32, 64), (64, 16), (64, 64), (48, 64)])
def test_outer_products_compile_for_hopper(depth, columns, tmp_path):
    kernel = load("radiance.fields.perceptron._layers_cuda").outer(depth, columns)
    code = compile_for_hopper(kernel.module, tmp_path)
    assert code.count("mma.sync.aligned.m16n8k16") == depth // 16 * columns // 8
    assert "movmatrix.sync.aligned.m8n8.trans.b16" in code


@pytest.mark.parametrize(("inputs", "lit"), [(16, False), (32, True), (48, True), (64, False)])
def test_networks_compile_for_hopper(inputs, lit, tmp_path):
    """The largest to machine code: there are registers and shared memory enough."""
    blocks = load("radiance.fields.perceptron._network_cuda")
    layers = [inputs // 2, 8, 24 if lit else 16, 32, 8]  # products of 16 samples x 16 with 16 x 8
    counts = {
        "density": sum(layers[:2]),
        "forward": sum(layers),
        # It needs neither the last layer's values nor gradients of the view.
        "backward": 3 * sum(layers) - 8 - 8,
    }
    for name, count in counts.items():
        given = (inputs,) if name == "density" else (inputs, lit)
        module = getattr(blocks, name)(*given).module
        code = compile_for_hopper(module, tmp_path / name)
        assert code.count("mma.sync.aligned.m16n8k16") == count
        if inputs == 64 or (inputs, lit) == (48, True):
            (cubin,) = wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=False)
            assert Path(cubin).stat().st_size > 0


def made(scalar):
    """Yield the kernels that are made for a precision."""
    for family, names in {
        "radiance.training._adam_cuda": ["adam"],
        "radiance.encodings": ["_spherical", "_positional", "_gather"],
        "radiance.wild.embeddings": ["gatherer", "copier"],
        "radiance.fields.perceptron.heads": ["_forward", "_color_backward", "_density_backward"],
    }.items():
        for name in names:
            yield f"{family}.{name}", getattr(load(family), name)(scalar)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_kernels_of_a_precision_compile_for_hopper(dtype, tmp_path):
    for name, kernel in made(wp.dtype_from_numpy(dtype)):
        compile_for_hopper(kernel.module, tmp_path / name)


@pytest.mark.parametrize("together", [1, 4])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_hash_encoding_compiles_for_hopper(dtype, together, tmp_path):
    kernel = load("radiance.fields._hash_cuda").encode(wp.dtype_from_numpy(dtype), together)
    code = compile_for_hopper(kernel.module, tmp_path)
    assert ("st.global.v4" in code) == (together == 4)


# Two numbers at a time, or integers, whose sums have no order.
@pytest.mark.parametrize(
    ("sums", "add"), [(wp.float32, "add.v2.f32"), (wp.int64, "add.u64")], ids=["float", "fixed"]
)
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_hash_backward_compiles_for_hopper(dtype, sums, add, tmp_path):
    kernel = load("radiance.fields._hash_cuda").backward(wp.dtype_from_numpy(dtype), sums)
    code = compile_for_hopper(kernel.module, tmp_path)
    assert f".global.{add}" in code


@pytest.mark.parametrize(
    ("sums", "add"), [(wp.float32, "add.v4.f32"), (wp.int64, "add.u64")], ids=["float", "fixed"]
)
def test_voxel_backward_compiles_for_hopper(sums, add, tmp_path):
    kernel = load("radiance.fields.voxel._rays_cuda").render_backward(sums)
    code = compile_for_hopper(kernel.module, tmp_path)
    assert f".global.{add}" in code
    assert (".global.add.f32" in code) == (sums is wp.float32)


@pytest.mark.parametrize("texel", [wp.vec4, wp.uint32])
def test_rendering_of_planes_compiles_for_hopper(texel, tmp_path):
    for shiny in (False, True):
        kernel = load("radiance.fields.planes.rays").renderer(texel, shiny)
        compile_for_hopper(kernel.module, tmp_path)
    if texel is wp.uint32:
        code = compile_for_hopper(load("radiance.fields.planes._rays_cuda"), tmp_path / "bytes")
        assert code.count("ld.global.nc.u32") + code.count("ld.global.nc.b32") == 16


@pytest.mark.parametrize(
    ("sums", "add"), [(wp.float32, "atom.global.add.f32"), (wp.int64, "add.u64")]
)
def test_planes_backward_compiles_for_hopper(sums, add, tmp_path):
    for name in ("scatterer", "shine_scatterer"):
        kernel = getattr(load("radiance.fields.planes._sums"), name)(sums, False)
        code = compile_for_hopper(kernel.module, tmp_path / name).replace("red.", "atom.")
        assert add in code
    for name in ("rays", "texels"):
        compile_for_hopper(load(f"radiance.fields.planes.{name}"), tmp_path / name)


def test_splats_compile_for_hopper(tmp_path):
    for name in ("projection", "lists", "learning", "batches", "_tiles_cuda"):
        code = compile_for_hopper(load(f"radiance.fields.splats.{name}"), tmp_path / name)
        if name == "_tiles_cuda":
            assert code.count("shfl.sync.bfly") == 12  # nine sums over the lanes of a warp
            assert ".global.add" not in code  # no sum depends on an order


def test_heads_and_weights_of_photographs_compile_for_hopper(tmp_path):
    for name in ("transient", "distractors", "embeddings", "appearance"):
        compile_for_hopper(load(f"radiance.wild.{name}"), tmp_path / name)
    for sums, add in ((wp.float32, "add.f32"), (wp.int64, "add.u64")):
        kernel = load("radiance.wild.transient").scatterer(sums, False)
        assert f".global.{add}" in compile_for_hopper(kernel.module, tmp_path / add)
