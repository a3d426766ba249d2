"""List the comments that begin with a word that cannot begin a sentence."""

import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("cvkern", "kernels", "tests", "profiling", "docs", ".ci")
BEGINS = re.compile(r"(of|that|which|for what|as|than|whose)\b", re.IGNORECASE)


def comments(file: Path) -> Iterator[tuple[int, str]]:
    """Yield the first line of each comment, with its number."""
    lines = file.read_text(encoding="utf-8").splitlines()
    if file.suffix == ".py":
        with file.open("rb") as text:
            tokens = list(tokenize.tokenize(text.readline))
        found = [t.start for t in tokens if t.type == tokenize.COMMENT]
    else:
        found = [(i + 1, line.index("//")) for i, line in enumerate(lines) if "//" in line]
    above = -1  # the last line that is all comment
    for row, column in found:
        alone = not lines[row - 1][:column].strip()
        if not alone or row != above + 1:
            yield row, lines[row - 1][column:].lstrip("#/ ")
        above = row if alone else above


def offenders() -> dict[str, list[str]]:
    """Return such comments by the files that have them."""
    found: dict[str, list[str]] = {}
    for path in (path for folder in FOLDERS for path in (ROOT / folder).rglob("*")):
        if path.suffix in (".py", ".cu", ".h") and "cvkern/kernels" not in path.as_posix():
            name = str(path.relative_to(ROOT))
            bad = [f"{name}:{row}: {text}" for row, text in comments(path) if BEGINS.match(text)]
            found.update({name: bad} if bad else {})
    return found


if __name__ == "__main__":
    lines = [line for _, bad in sorted(offenders().items()) for line in bad]
    print("\n".join(lines), end="\n" if lines else "")
    sys.exit(bool(lines))
