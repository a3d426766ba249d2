"""The CUDA kernels compile: Warp brings the compiler, which needs no GPU."""

import importlib
import pkgutil
import re
from pathlib import Path

import pytest
import warp as wp

import cvkern.kernels.warp as kernels

PACKAGE = f"{kernels.__name__}."
NAMES = [
    m.name.removeprefix(PACKAGE)
    for m in pkgutil.walk_packages(kernels.__path__, PACKAGE)
    if not m.ispkg and not m.name.endswith("_cpu")
]


def has_kernels(name):
    """Tell whether a module has kernels of its own before any is made on use."""
    importlib.import_module(f"{PACKAGE}{name}")
    return bool(wp.get_module(f"{PACKAGE}{name}").kernels)


ROUNDED = {"color.differences", "color.spaces", "color.surroundings"}
MODULES = [name for name in NAMES if has_kernels(name)]


@pytest.mark.parametrize("name", MODULES)
def test_compiles_for_hopper(name, tmp_path):
    kernels.start("cpu", None)
    module = importlib.import_module(f"{PACKAGE}{name}")
    (ptx,) = wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=True)
    code = Path(ptx).read_text()
    assert ".target sm_90" in code
    # Equal bits: no product is fused with a sum, except for powers, logarithms and cosines, which
    # are CUDA's own, and radiance fields, which are held to tolerances.
    if name not in ROUNDED and not name.startswith("radiance."):
        assert "fma.rn.f32" not in code


@pytest.mark.parametrize("name", NAMES)
def test_blocks_are_numbered_along_one_axis(name):
    """Without grid strides Warp folds more than 2^24 threads into three dimensions."""
    text = (Path(kernels.__file__).parent / f"{name.replace('.', '/')}.py").read_text()
    assert "blockIdx" not in text or '"default_grid_stride": False' not in text


def cost_kernels():
    """Kernels of matching costs and of windows that are compiled when they are first used."""
    from cvkern.kernels.codes.stereo import Cost
    from cvkern.kernels.warp.stereo import _windows_cuda as matching
    from cvkern.kernels.warp.stereo.costs import _census_cuda as census
    from cvkern.kernels.warp.stereo.costs import _windows_cuda as windows

    byte, word, integer, real, wide = wp.uint8, wp.uint16, wp.int32, wp.float32, wp.float64
    for scalar in (byte, real):
        yield from (census.census_kernel(scalar, symmetric) for symmetric in (False, True))
    for cost in (Cost.SAD, Cost.SSD, Cost.BIRCHFIELD_TOMASI):
        for scalar, kept in ((byte, word), (byte, integer), (real, real)):
            yield windows.sum_down(cost, scalar, kept)
    yield windows.sum_down(Cost.CENSUS, wp.uint64, word)
    for scalar, kept in ((byte, integer), (real, wide)):
        yield windows.sum_down(Cost.ZNCC, scalar, kept)
        yield windows.correlate_along(kept)
    for kept, out in ((word, byte), (word, word), (integer, real), (real, real)):
        yield windows.sum_along(kept, out)
    yield census.distances
    yield from map(census.census_of_24, (True, False))
    for words in matching.WORDS:
        yield matching.match_kernel(words)


def stereo_kernels():
    """Kernels of semi-global matching that are compiled when they are first used."""
    from cvkern.kernels.warp.stereo import _winners_cuda as winner
    from cvkern.kernels.warp.stereo.paths import _aggregation_cuda as semi_global
    from cvkern.kernels.warp.stereo.paths import _costs_cuda as match_costs
    from cvkern.kernels.warp.stereo.paths import _matching_cuda as match
    from cvkern.kernels.warp.stereo.paths import _steps_cuda as paths
    from cvkern.kernels.warp.stereo.refinement import _medians_cuda as disparity
    from cvkern.kernels.warp.stereo.refinement._gaps_cuda import fill_empty_rows, fill_rows

    byte, word = wp.uint8, wp.uint16
    for radius, contrast in ((0, 1), (6, 40), (15, 3000)):
        yield from disparity.medians(radius, contrast)
    yield from (fill_rows, fill_empty_rows)
    yield from cost_kernels()
    yield match_costs.pack
    for aligned in (True, False):
        yield match_costs.match_costs_kernel(aligned)
    for scalar in (byte, word, wp.float32):
        yield winner.pick_kernel(scalar, 8, 16 // wp.types.type_size_in_bytes(scalar))
        yield winner.pick_kernel(scalar, 32, 1)
        yield winner.pick_right_kernel(scalar)
    for scalar in (byte, word):
        yield semi_global.pad(scalar)
    for scalar, line, depth in ((byte, byte, 1), (byte, word, 100), (word, byte, 500)):
        for adaptive, whole in ((True, False), (False, True)):
            steps = paths.PATHS[16][adaptive]
            yield paths.walk(scalar, line, *paths.lanes(depth), steps, whole, adaptive, whole)
        yield semi_global.collect(scalar, line, 4)
    for line, count, depth in ((byte, 4, 1), (byte, 8, 128), (word, 8, match.MOST_DISPARITIES)):
        yield match.winners(line, count, *match.tile(depth))


def joined(kernels, name):
    """Yield modules of kernels that each have their own: one for all that have equal options."""
    by_options = {}
    for kernel in kernels:
        by_options.setdefault(tuple(sorted(kernel.module.options.items())), []).append(kernel)
    for n, (options, group) in enumerate(by_options.items()):
        module = wp.Module(f"{name}_{n}", None)
        module.options.update(options)
        # A module does not keep all kernels of one name alive.
        yield module, [wp.Kernel(k.func, k.key, module, options=dict(k.options)) for k in group]


def native_code(kernel):
    """Return the C++ code of a kernel, if it has any."""
    body = kernel.func.__globals__.get("body")
    return getattr(body, "native_snippet", None) or ""


def test_stereo_compiles_for_hopper_and_fuses_no_product_with_a_sum(tmp_path):
    kernels.start("cpu", None)
    made = list(stereo_kernels())
    entries = 0
    for module, _held in joined(made, "stereo_for_hopper"):
        (ptx,) = wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=True)
        code = Path(ptx).read_text()
        entries += code.count(".entry")
        assert "fma.rn.f" not in code
    assert entries == len(made) == len({kernel.module.name for kernel in made})


def test_stereo_has_shared_memory_and_instructions_of_older_gpus(tmp_path):
    """To machine code of the GPU with the least shared memory, and without Ampere's instructions.

    Kernels that name neither are the same on every GPU.
    """
    kernels.start("cpu", None)
    made = [k for k in stereo_kernels() if re.search("__shared__|__CUDA_ARCH__", native_code(k))]
    assert {"walk", "winners", "match", "pick_right"} <= {kernel.key for kernel in made}
    for module, _held in joined(made, "stereo_for_turing"):
        (cubin,) = wp.compile_aot_module(module, arch=75, module_dir=tmp_path, use_ptx=False)
        assert Path(cubin).stat().st_size > 0


def test_robust_fits_fuse_no_product_with_a_sum(tmp_path):
    from cvkern.kernels.warp.geometry import _robust_cuda as robust

    kernels.start("cpu", None)
    for kernel in (robust.propose, robust.refine, robust.mark):
        folder = tmp_path / kernel.key
        (ptx,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=folder, use_ptx=True)
        assert "fma.rn.f" not in Path(ptx).read_text()


def test_extrema_fuse_no_product_with_a_sum(tmp_path):
    from cvkern.kernels.warp.features.keypoints import _extrema_cuda as extrema

    kernels.start("cpu", None)
    for n, kernel in enumerate((extrema.move, *map(extrema.mark, (1, 3, 8)))):
        folder = tmp_path / f"{n}"
        (ptx,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=folder, use_ptx=True)
        assert "fma.rn.f" not in Path(ptx).read_text()


def test_matching_compiles_since_ampere(tmp_path):
    from cvkern.kernels.warp.features import _matching_cuda as matching

    kernels.start("cpu", None)
    for n, kernel in enumerate(matching.matches.values()):
        folder = tmp_path / f"{n}"
        (cubin,) = wp.compile_aot_module(
            kernel.module, arch=matching.OLDEST, module_dir=folder, use_ptx=False
        )
        assert Path(cubin).stat().st_size > 0
