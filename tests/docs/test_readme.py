"""The README is true: commands, examples, names, links."""

import doctest
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

import cvkern
from cvkern.app import cli

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
DOCUMENTS = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
EXAMPLES = [body for language, body in BLOCK.findall(README) if language == "python"]


def command(*arguments):
    """Ask the script of CI for a command of the README."""
    script = ROOT / ".ci" / "readme_commands.py"
    call = [sys.executable, str(script), *arguments]
    return subprocess.run(call, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize(
    ("name", "extra", "end"),
    [("tour", "demo", "cvkern tour"), ("tests", "test", "-m pytest -n 2 --dist loadfile")],
)
def test_commands(name, extra, end):
    said = command(name)
    assert said.returncode == 0
    assert said.stdout.startswith("python3 -m venv ")
    assert f'pip install ".[{extra}]"' in said.stdout
    assert said.stdout.endswith(f"{end}\n")


@pytest.mark.parametrize("arguments", [(), ("nothing",), ("tour", "tests")])
def test_no_such_command(arguments):
    said = command(*arguments)
    assert said.returncode == 1
    assert "NAME must be one of ('tour', 'tests')" in said.stderr


def test_ci_runs_what_pre_commit_runs():
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    entries = re.findall(r"entry: (.+)", hooks)
    assert len(entries) == 6
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert [e for e in entries if f'"{e}"' not in script] == []


def test_examples():
    """In order, in one namespace, as a reader types them."""
    assert len(EXAMPLES) >= 4
    parser, names, said = doctest.DocTestParser(), {}, []
    runner = doctest.DocTestRunner(verbose=False)
    for example in EXAMPLES:
        test = parser.get_doctest(example, names, "README", "README.md", 0)
        assert test.examples
        assert runner.run(test, out=said.append, clear_globs=False).failed == 0, "".join(said)
        names = test.globs


def test_names():
    named = set(re.findall(r"\bcvkern((?:\.\w+)+)", README))
    assert len(named) >= 5
    for path in named:
        pkgutil.resolve_name(f"cvkern{path}")  # raises an error where there is nothing


def test_commands_are_complete():
    about = README.split("**The command** `cvkern` has ")[1].split(":")[0]
    named = re.findall(r"`(\w+)`", about)
    for name in named:
        assert callable(getattr(cli, name))
    assert len(set(named)) == len(cli.app.registered_commands + cli.app.registered_groups)


def test_length():
    assert len(README.splitlines()) <= 150


def slug(heading):
    """Return the anchor that a Markdown page gives a heading."""
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links(document):
    text = (ROOT / document).read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)]+)\)", text):
        if link.startswith("https://"):
            continue
        file, _, anchor = link.partition("#")
        assert (ROOT / (file or document)).is_file(), link
        if anchor:
            target = (ROOT / (file or document)).read_text(encoding="utf-8")
            headings = re.findall(r"^#+ (.+)$", target, re.MULTILINE)
            assert anchor in map(slug, headings), link


def test_changelog_has_this_version():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(rf"^## \[{re.escape(cvkern.__version__)}\]", changelog, re.MULTILINE)
