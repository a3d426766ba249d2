"""Features on CUDA have the bits of the CPU, in every run."""

import numpy as np
import pytest
import skimage.data

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.on_cuda import LIBRARIES, assert_equal_bits, give, on_gpu, reference, take

CAMERA = skimage.data.camera()[100:300, 150:390]
CALLS = {
    "sift": cvkern.sift,
    "sift_spread": lambda x: cvkern.sift(x, 70, spread=True, root=False, double=False),
    "orb": cvkern.orb,
    "corner_harris": cvkern.corner_harris,
    "corner_shi_tomasi": cvkern.corner_shi_tomasi,
    "corner_peaks": lambda x: cvkern.corner_peaks(cvkern.corner_harris(x), 3),
    "corner_subpix": lambda x: cvkern.corner_subpix(
        x, cvkern.corner_peaks(cvkern.corner_harris(x), 3)
    ),
}


@pytest.mark.parametrize("backend", KERNEL_SETS)
@pytest.mark.parametrize("name", CALLS)
def test_bits_are_those_of_the_cpu(gpu, name, backend):
    want = reference(CALLS[name], CAMERA)
    for _ in range(3):
        assert_equal_bits(on_gpu(CALLS[name], CAMERA, backend), want)


@pytest.mark.parametrize("backend", KERNEL_SETS)
@pytest.mark.parametrize("metric", ["euclidean", "hamming"])
def test_matches_are_those_of_the_cpu(gpu, metric, backend):
    rng = np.random.default_rng(0)
    heap = [rng.integers(0, 256, (n, 128)).astype(np.uint8) for n in (300, 1, 513, 0)]

    def call(_):
        return tuple(cvkern.match_images(heap, max_ratio=0.95, metric=metric))

    assert_equal_bits(on_gpu(call, CAMERA, backend), reference(call, CAMERA))


@pytest.mark.parametrize("library", LIBRARIES)
def test_arrays_of_other_libraries(gpu, library):
    want = reference(cvkern.sift, CAMERA)
    found = cvkern.sift(give(library, CAMERA))
    for a, b in zip(found, want, strict=True):
        np.testing.assert_array_equal(take(a), b)


def test_replays_of_several_sizes_give_the_bits_of_the_cpu(gpu):
    """From its second time on, a scale space is one graph; released memory is not used again."""
    images = [CAMERA, np.ascontiguousarray(CAMERA[::-1]), CAMERA[:150, :170].copy()]
    wanted = [reference(cvkern.sift, image) for image in images]
    for turn in range(4):
        for image, want in zip(images, wanted, strict=True):
            assert_equal_bits(on_gpu(cvkern.sift, image, "warp"), want)
        if turn == 1:
            cvkern.release_memory()


def test_a_full_queue_of_extrema_loses_none(gpu, monkeypatch):
    from cvkern.kernels.warp.features.keypoints import extrema

    want = reference(cvkern.sift, CAMERA)
    monkeypatch.setattr(extrema, "LEAST", 3)
    monkeypatch.setattr(extrema, "SHARE", 1 << 30)
    assert_equal_bits(on_gpu(cvkern.sift, CAMERA, "warp"), want)
