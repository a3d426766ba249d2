"""Check the format of the native code with clang-format; with ``--fix``, format it."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def main(arguments: list[str]) -> int:
    """Run clang-format, and return its exit code."""
    if arguments not in ([], ["--fix"]):
        print(f"arguments must be none or --fix, got {arguments}", file=sys.stderr)
        return 1
    files = sorted(
        str(path)
        for folder in ("kernels", "tests")
        for ending in ("cu", "h")
        for path in (ROOT / folder).glob(f"**/*.{ending}")
    )
    task = ["-i"] if arguments else ["--dry-run", "--Werror"]
    return subprocess.run(["clang-format", *task, *files], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
