"""Print a command of README.md: ``python .ci/readme_commands.py NAME``.

A command is the fenced block right below a line ``<!-- command: NAME -->``.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

README = Path(__file__).resolve().parent.parent / "README.md"
BLOCK = re.compile(r"^<!-- command: (\w+) -->\n```sh\n(.+?)^```$", re.MULTILINE | re.DOTALL)


def commands(text: str) -> dict[str, str]:
    """Return the marked blocks by their names."""
    found = BLOCK.findall(text)
    if len(found) != text.count("<!-- command:") or len(dict(found)) != len(found):
        raise ValueError("README.md must have one ```sh block right below each marker")
    return dict(found)


def main() -> None:
    """Print the block that the command line names."""
    known = commands(README.read_text(encoding="utf-8"))
    if len(sys.argv) != 2 or sys.argv[1] not in known:
        sys.exit(f"NAME must be one of {tuple(known)}, got {sys.argv[1:]}")
    print(known[sys.argv[1]], end="")


if __name__ == "__main__":
    main()
