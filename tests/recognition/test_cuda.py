"""Recognition on CUDA has the bits of the CPU, in every run."""

import numpy as np
import pytest

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.on_cuda import LIBRARIES, assert_equal_bits, give, on_gpu, reference, take
from tests.recognition.alphabet import clutter, put, thing, things

IMAGE = clutter((120, 160), 31)
put(IMAGE, thing(), 50, 70)
PATCHES = np.random.default_rng(0).random((300, 16, 16)).astype(np.float32)
PATCHES[150:] = 0.7 * PATCHES[:150] + 0.3 * PATCHES[150:]


def learn_and_find(image):
    model = cvkern.ShapeModel(100).fit(things(2), negatives=[clutter((60, 90), 1)])
    return tuple(model.detect(image, threshold=-3.0))


CALLS = {
    "agglomerative": lambda _: tuple(cvkern.learn_codebook(PATCHES, method="agglomerative")),
    "kmeans": lambda _: tuple(cvkern.learn_codebook(PATCHES, 40)),
    "model": learn_and_find,
}


@pytest.mark.parametrize("backend", KERNEL_SETS)
@pytest.mark.parametrize("name", CALLS)
def test_bits_are_those_of_the_cpu(gpu, name, backend):
    want = reference(CALLS[name], IMAGE)
    for _ in range(2):
        assert_equal_bits(on_gpu(CALLS[name], IMAGE, backend), want)


@pytest.mark.parametrize("library", LIBRARIES)
def test_arrays_of_other_libraries(gpu, library):
    model = cvkern.ShapeModel(60).fit(things(2))
    want = model.detect(IMAGE)
    found = model.detect(give(library, IMAGE))
    for a, b in zip(found, want, strict=True):
        np.testing.assert_array_equal(take(a), b)


def test_a_graph_finds_what_the_cpu_finds(gpu, monkeypatch):
    """Pictures of one size share a graph; the room for votes grows when it is too small."""
    search = "cvkern.recognition.search."
    monkeypatch.setattr(search + "ROOM", 64)
    monkeypatch.setattr(search + "_rooms", {})
    model = cvkern.ShapeModel(60).fit(things(2), masks=[np.ones((32, 48), bool)] * 2)
    given = give("torch", IMAGE.copy())
    for number in range(5):
        image = np.ascontiguousarray(np.roll(IMAGE, 13 * number, axis=1))
        given[...] = give("torch", image)
        want, masks = model.segment(image, threshold=-3.0 + number)
        found, own = model.segment(given, threshold=-3.0 + number)
        again = model.segment(given, threshold=-3.0 + number)
        assert len(want.scores) > 0
        for a, b in zip((*found, own), (*want, masks), strict=True):
            np.testing.assert_array_equal(take(a), b)
        for a, b in zip((*again.objects, again.masks), (*want, masks), strict=True):
            np.testing.assert_array_equal(take(a), b)
