"""Kernels that take the host's arrays in stages: on the CPU, and with Vulkan where it works."""

# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false

import importlib

import numpy as np
import pytest
import skimage.data

import cvkern
from cvkern.kernels import taichi as kernel_set
from cvkern.kernels.taichi import _launch, _staging
from cvkern.kernels.taichi.features.keypoints import descriptors
from tests.calls import CALLS
from tests.on_cuda import assert_equal_bits

ti = kernel_set.taichi  # imported there, without its warnings
f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)


@ti.kernel
def write_some(array: f32_1):
    for i in range(array.shape[0] // 2):
        array[2 * i] = 7.0


@ti.kernel
def copy(src: f32_2, dst: f32_2):
    for y, x in src:
        dst[y, x] = src[y, x] + 1.0


def staged(primitive, *args):
    kernel_set.start("cpu", None)
    with _launch._lock:
        _staging.launch(primitive, args, {})


def test_what_no_kernel_writes_stays():
    array = np.arange(7, dtype=np.float32)
    staged(write_some, array)
    np.testing.assert_array_equal(array, [7, 1, 7, 3, 7, 5, 6])


def test_inputs_are_not_written():
    src, dst = np.ones((3, 4), np.float32), np.zeros((3, 4), np.float32)
    src[0, 0] = np.float32(1e-40)  # a copy by arithmetic would make it 0
    src.flags.writeable = False
    staged(copy, src, dst)
    assert src[0, 0] == np.float32(1e-40)
    np.testing.assert_array_equal(dst[1:], 2)


def test_views_and_scratch_are_one_memory():
    def primitive(array):
        between = _staging.stage().scratch((3, 4), np.float32)
        copy(array.reshape(3, 4), between)
        write_some(between.reshape(-1))  # the same memory in another shape
        copy(between, array.reshape(3, 4))
        write_some(array[6:])  # a part of it

    def outer(array):
        _staging.launch(primitive, (array,), {})

    array = np.zeros(12, np.float32)
    staged(outer, array)
    np.testing.assert_array_equal(array, [8, 2, 8, 2, 8, 2, 7, 2, 7, 2, 7, 2])


def test_absent_drivers_are_refused():
    for device in {"vulkan", "metal"} - set(cvkern.devices("taichi")):
        message = f"device must be one that taichi finds here, .*, got '{device}'"
        with pytest.raises(ValueError, match=message):
            cvkern.use(backend="taichi", device=device)
    with pytest.raises(ValueError, match="device must be one that warp finds here"):
        cvkern.use(backend="warp", device="vulkan")


def test_a_driver_that_computes_wrongly_is_refused(monkeypatch):
    kernel_set.start("cpu", None)
    monkeypatch.setattr(_staging, "_count", lambda number, sums: None)
    with pytest.raises(RuntimeError, match="computes loops wrongly: 0 of 1000 counts"):
        _staging.check("vulkan")


@pytest.mark.parametrize("name", ["gaussian", "median", "canny", "hough_line", "stereo_match"])
def test_vulkan_gives_the_bits_of_the_cpu(name):
    if "vulkan" not in cvkern.devices("taichi"):
        pytest.skip("there is no Vulkan")
    image = skimage.data.camera()[::4, ::4].copy()
    with cvkern.use(backend="taichi", device="cpu"):
        want = CALLS[name](image)
    try:
        with cvkern.use(backend="taichi", device="vulkan"):
            got = CALLS[name](image)
    except RuntimeError as refused:
        pytest.skip(str(refused))
    assert_equal_bits(got, want)


# Floats that Vulkan's own divisions, roots and powers change. The largest difference on an H200 is
# 1e-5 of the value, in a triangulation, which divides by a small difference of products.
ROUNDED = {
    "convert_color",
    "detect_chessboard",
    "merge_exposures",
    "normals_from_depth",
    "retinex",
    "triangulate_columns",
}
REFUSED = {  # by reason
    **dict.fromkeys(("deltaE_ciede2000", "integrate_normals"), "functions of float64"),
    **dict.fromkeys(
        ("sift", "recognize_panoramas", "match_photographs", "stitch"), "descriptors of SIFT"
    ),
}
FAMILIES = [
    *("filters", "edges", "hough", "stereo", "color", "transform", "features", "raw", "shading"),
    *("structured_light", "geometry", "panorama", "recognition"),
]


@pytest.mark.parametrize("family", FAMILIES)
def test_vulkan_computes_every_family(family):
    """Each warm-up call gives the bits of the CPU, a value within a tolerance, or is refused."""
    if "vulkan" not in cvkern.devices("taichi"):
        pytest.skip("there is no Vulkan")
    calls = list(importlib.import_module(f"cvkern.{family}._warmup").calls())
    try:
        with cvkern.use(backend="taichi", device="vulkan"):
            cvkern.box(np.ones((3, 4)))
    except RuntimeError as refused:
        pytest.skip(str(refused))
    with cvkern.use(backend="taichi", device="cpu"):
        wanted = [call() for _, call in calls]
    for (name, call), want in zip(calls, wanted, strict=True):
        with cvkern.use(backend="taichi", device="vulkan"):
            if name in REFUSED:
                with pytest.raises(RuntimeError, match=REFUSED[name]):
                    call()
                continue
            got = call()
        for a, b in zip(arrays_in(got), arrays_in(want), strict=True):
            if name in ROUNDED:
                np.testing.assert_allclose(a, b, rtol=2e-5, atol=1e-6, err_msg=name)
            else:
                assert_equal_bits(a, b)


def arrays_in(result):
    """Return the arrays of a result, however they are nested."""
    if isinstance(result, (tuple, list)):
        return [array for part in result for array in arrays_in(part)]
    return [np.atleast_1d(result)] if isinstance(result, (np.ndarray, np.generic, float)) else []


def test_kernels_that_were_wrong_are_refused():
    with pytest.raises(RuntimeError, match="'cpu' or 'cuda' for descriptors of SIFT"):
        _staging.launch(descriptors.describe, (), {})


def test_functions_that_vulkan_lacks_are_refused():
    def primitive(array):
        raise RuntimeError("[spirv_codegen.cpp:visit@955] Instruction Exp(27) does not 64bits")

    with pytest.raises(RuntimeError, match="device must be one with functions of float64"):
        staged(primitive, np.zeros(3))

    def other(array):
        raise RuntimeError("something else")

    with pytest.raises(RuntimeError, match="something else"):
        staged(other, np.zeros(3))
