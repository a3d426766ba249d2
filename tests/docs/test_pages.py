"""The pages in docs/ are true: every name is on its page, files exist, calls agree."""

import importlib
import re
import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest

import cvkern

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
FAMILIES = sorted(name for name in cvkern._NAMES if name[0] != "_") + list(cvkern._NAMESPACES)
PAGES = sorted(DOCS.glob("*.md")) + sorted(DOCS.glob("*/[a-z]*.md"))


def page(family):
    file = DOCS / "families" / f"{family}.md"
    assert file.is_file(), f"the family {family} has no page: write {file.relative_to(ROOT)}"
    return file.read_text(encoding="utf-8")


def rows(text):
    """Return the cells of each row of each table of a page, without heads."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]
    rules = {i for i, row in enumerate(cells) if all(re.fullmatch(r":?-+:?", c) for c in row)}
    return [row for i, row in enumerate(cells) if i not in rules and i + 1 not in rules]


def public(family):
    return sorted(importlib.import_module(f"cvkern.{family}").__all__)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_name_is_in_the_table_of_its_page(family):
    named = [name for row in rows(page(family)) for name in re.findall(r"`(\w+)`", row[0])]
    listed = [name for name in named if hasattr(importlib.import_module(f"cvkern.{family}"), name)]
    assert sorted(set(listed)) == public(family)


@pytest.mark.parametrize("family", FAMILIES)
def test_tests_that_a_page_names_exist(family):
    named = re.findall(r"`([\w/]*test_\w+\.py)`", page(family))
    assert named
    assert [name for name in named if not (ROOT / "tests" / family / name).is_file()] == []


@pytest.mark.parametrize("family", FAMILIES)
def test_a_page_is_listed(family):
    listed = (DOCS / "families" / "index.md").read_text(encoding="utf-8").splitlines()
    assert family in listed
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"(docs/families/{family}.md)" in readme
    front = (DOCS / "index.md").read_text(encoding="utf-8")
    assert f"(families/{family}.md) |" in front


def test_every_name_is_in_the_reference():
    reference = SimpleNamespace(**runpy.run_path(str(DOCS / "extensions" / "reference.py")))
    pages = {family: reference.page(family, *rest) for family, rest in reference.families().items()}
    assert set(pages) == {*FAMILIES, "runtime"}
    for family in FAMILIES:
        home = f"cvkern.{family}" if family in cvkern._NAMESPACES else "cvkern"
        for name in public(family):
            assert re.search(rf"^.. auto\w+:: {home}.{name}$", pages[family], re.MULTILINE), name
    everywhere = "".join(pages.values())
    for name in cvkern.__all__:
        assert f":: cvkern.{name}\n" in everywhere


@pytest.mark.parametrize("file", PAGES, ids=lambda file: str(file.relative_to(DOCS)))
def test_files_that_are_named_exist(file):
    text = file.read_text(encoding="utf-8")
    named = re.findall(r"`((?:kernels|cvkern|tests|profiling|docs)/[\w/.-]+\.\w+)`", text)
    named = [name.replace("FAMILY", "stereo").replace("MODULE", "windows") for name in named]
    assert [name for name in named if not (ROOT / name).is_file()] == []
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([\w/.-]+\.md[^)]*)\)", text)]
    made = [link for link in links if "_generated" not in link]
    assert [link for link in made if not (file.parent / link).is_file()] == []


def test_each_native_file_has_a_row_and_each_row_its_files():
    """A name without a folder in a row lies in the folder of the name before.

    Counts of lines are true to a tenth, so that small changes need no new count.
    """
    text, named = (DOCS / "native.md").read_text("utf-8"), set()
    warp = DOCS.parent / "kernels" / "warp"
    for row, count in re.findall(r"^\| [^|]+ \|([^|]+)\| (\w+|) *\|", text, re.M):
        folder, lines = "", 0
        for place, name in re.findall(r"`((?:\w+/)*)(\w+\.(?:h|cu))`", row):
            folder = place or folder
            named.add(folder + name)
            lines += len((warp / folder / name).read_text("utf-8").splitlines())
        if count.isdigit():
            assert abs(lines - int(count)) <= 5 + lines / 10, f"{row.strip()} have {lines} lines"
    files = {str(f.relative_to(warp)) for f in warp.rglob("*.*") if f.suffix in (".h", ".cu")}
    assert sorted(files - named) == []
    assert sorted(named - files) == []
    lines = sum(len((warp / file).read_text("utf-8").splitlines()) for file in files)
    said = re.search(r"Native files have some (\d+) (\d{3}) lines", text)
    assert said
    assert abs(lines - int("".join(said.groups()))) < 500, f"native files have {lines} lines"


def test_the_recipe_names_files_that_exist():
    recipe = (DOCS / "built.md").read_text(encoding="utf-8").split("## Add a primitive\n")[1]
    assert len(re.findall(r"`(?:kernels|cvkern|tests|docs)/[\w/.]+\.(?:py|md)`", recipe)) > 5


def test_names_exist():
    for file in PAGES:
        text = file.read_text(encoding="utf-8")
        for path in set(re.findall(r"\bcvkern((?:\.\w+)+)\(", text)):
            found = cvkern
            for part in path.split(".")[1:]:
                found = getattr(found, part, None)
            assert found is not None, f"{file.name}: cvkern{path}"


EXAMPLES = sorted((DOCS / "examples").glob("*/plot_*.py"))


def test_there_are_examples():
    assert len(EXAMPLES) >= 12


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_an_example_is_short_and_explains_itself(file):
    text = file.read_text(encoding="utf-8")
    assert 15 <= len(text.splitlines()) <= 40
    _, about, code = text.split('"""', 2)
    title, rule, *sentences = about.strip().splitlines()
    assert len(rule) == len(title)
    assert set(rule) == {"="}
    assert " ".join(sentences).strip().endswith(".")
    assert "cvkern" in code
    assert "plt.show()" in code
