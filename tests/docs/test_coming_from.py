"""The tables in docs/coming_from: each line runs, and agrees as its column says."""

import doctest
import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from tests.docs.test_pages import rows

FOLDER = Path(__file__).parents[2] / "docs" / "coming_from"
NEEDS = {"skimage": "skimage", "opencv": "cv2", "pytorch": "torch"}
TEXTS = {name: (FOLDER / f"{name}.md").read_text(encoding="utf-8") for name in NEEDS}
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINES = [(name, *row) for name, text in TEXTS.items() for row in rows(text)]
# Sums of float32 whose terms are at most the peak of the result, within some 50 roundings.
ROUNDING = 50 * 2.0**-24


def plain(found):
    """Return numbers as NumPy's, whatever holds them."""
    return np.asarray(found.numpy() if hasattr(found, "numpy") else found)


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """What the first block of each page defines, run once in a folder of its own."""
    known = {}

    def get(name):
        pytest.importorskip(NEEDS[name])
        if name not in known:
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(tmp_path_factory.mktemp(name))
                known[name] = Path.cwd(), {}
                exec(BLOCK.findall(TEXTS[name])[0], known[name][1])
        return known[name]

    return get


def test_there_are_lines():
    assert len(LINES) >= 40
    assert {same for _, _, _, same, _ in LINES} == {"every element", "rounding", "no"}
    assert [line for line in LINES if line[3] == "no" and not line[4]] == []


@pytest.mark.parametrize(("name", "old", "new", "same", "differs"), LINES)
def test_line(names, monkeypatch, name, old, new, same, differs):
    folder, known = names(name)
    monkeypatch.chdir(folder)
    old, new = (eval(cell.strip("`").replace("\\|", "|"), known) for cell in (old, new))
    if same == "no":
        assert old is not None
        assert new is not None
        return
    old, new = plain(old), plain(new)
    assert old.shape == new.shape
    assert old.size
    if same == "every element":
        np.testing.assert_array_equal(new, old)
    else:
        peak = np.abs(old[np.isfinite(old)]).max()
        np.testing.assert_allclose(new, old, rtol=ROUNDING, atol=ROUNDING * peak)


@pytest.mark.parametrize("name", NEEDS)
def test_examples(name):
    """The examples below the tables, as a reader types them."""
    if importlib.util.find_spec(NEEDS[name]) is None:
        pytest.skip(f"{NEEDS[name]} is not installed")
    for block in BLOCK.findall(TEXTS[name])[1:]:
        test = doctest.DocTestParser().get_doctest(block, {}, name, str(FOLDER), 0)
        said: list[str] = []
        assert test.examples
        assert doctest.DocTestRunner(verbose=False).run(test, out=said.append).failed == 0, said
