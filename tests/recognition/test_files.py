"""Saved models: they find the same, and what is not a whole model is refused by name."""

import json
import zipfile

import numpy as np
import pytest

import cvkern
from tests.recognition.alphabet import clutter, put, thing, things

SHAPE = (100, 120)


@pytest.fixture(scope="module")
def model():
    with cvkern.use(backend="warp"):
        masks = [np.ones((32, 48), bool)] * 3
        return cvkern.ShapeModel(40, patch=12).fit(
            things(3), masks=masks, negatives=[clutter((60, 90), 1)]
        )


@pytest.fixture
def saved(model, tmp_path):
    model.save(tmp_path / "model.npz")
    return tmp_path / "model.npz"


def rewritten(path, **changes):
    """Write the arrays of a model again, some of them changed or left out."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    for name, change in changes.items():
        if name == "header":
            header = json.loads(arrays["header"].tobytes())
            change(header)
            arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
        elif change is None:
            del arrays[name]
        else:
            arrays[name] = change(arrays[name])
    np.savez(path, **arrays)


def test_a_loaded_model_finds_the_same(backend, model, saved):
    image = clutter(SHAPE, 3)
    put(image, thing(), 30, 40)
    loaded = cvkern.ShapeModel.load(saved)
    assert (loaded.box, loaded.threshold) == (model.box, model.threshold)
    want = model.detect(image, threshold=-2.0)
    assert len(want.boxes) > 0
    for a, b in zip(loaded.detect(image, threshold=-2.0), want, strict=True):
        np.testing.assert_array_equal(a, b)
    loaded.save(saved)  # over itself
    assert cvkern.ShapeModel.load(saved).box == model.box


def test_a_model_cut_short(saved):
    whole = saved.read_bytes()
    for share in (0, 0.01, 0.3, 0.7, 0.99):
        saved.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(ValueError, match="path must be a whole model"):
            cvkern.ShapeModel.load(saved)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"words": None}, "words"),
        ({"weights": lambda a: a[:, 1:]}, "shapes that agree"),
        ({"entries": lambda a: a[1:]}, "shapes that agree"),
        ({"words": lambda a: a.astype(np.int16)}, "words must be int8"),
        ({"starts": lambda a: a[::-1].copy()}, "starts must rise"),
        ({"entries": lambda a: a * 9999}, "entries must be in range"),
        ({"weights": lambda a: a + 2**20}, "weights must be in range"),
        ({"header": lambda h: h.update(version=99)}, "version 99"),
        ({"header": lambda h: h.update(format="cvkern radiance field")}, "cvkern shape model"),
        ({"header": lambda h: h["settings"].update(most=99)}, "settings must be in range"),
        ({"header": lambda h: h["settings"].update(other=1)}, "settings must be"),
        ({"header": lambda h: h["settings"]["sampling"].update(points="all")}, "in range"),
        ({"header": lambda h: h.update(threshold=float("inf"))}, "bias and threshold"),
    ],
)
def test_wrong_contents(saved, changes, said):
    rewritten(saved, **changes)
    with pytest.raises(ValueError, match=said):
        cvkern.ShapeModel.load(saved)


def test_sizes_are_checked_before_anything_is_read(saved, monkeypatch):
    """An array that claims to be far larger than the file."""
    with zipfile.ZipFile(saved) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    whole = entries["words.npy"]
    fitted = cvkern.ShapeModel.load(saved)._fitted
    assert fitted is not None
    shape = fitted.words.shape
    bloated = whole.replace(str(shape).encode(), f"({shape[0]}{'0' * 3}, {shape[1]})".encode())
    entries["words.npy"] = bloated.replace(b"   \n", b"\n", 1)
    with zipfile.ZipFile(saved, "w") as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    monkeypatch.setattr(np.lib.npyio.NpzFile, "__getitem__", lambda *_: pytest.fail("was read"))
    with pytest.raises(ValueError, match="words must have the"):
        cvkern.ShapeModel.load(saved)


def test_paths(model, tmp_path):
    with pytest.raises(ValueError, match=r"path must end in \.npz"):
        model.save(tmp_path / "model.txt")
    with pytest.raises(FileNotFoundError, match="folder that exists"):
        model.save(tmp_path / "none" / "model.npz")
    with pytest.raises(FileNotFoundError, match="file that exists"):
        cvkern.ShapeModel.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("no model")
    with pytest.raises(ValueError, match="must be a model of cvkern"):
        cvkern.ShapeModel.load(tmp_path / "text.npz")
