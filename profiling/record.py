"""The facts that a result needs to be read later: machine, versions, commit."""

from __future__ import annotations

import contextlib
import datetime
import importlib
import importlib.metadata
import json
import os
import platform
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from .clock import cores

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = (
    "warp-lang",
    "taichi",
    "numpy",
    "scipy",
    "scikit-image",
    "opencv-python-headless",
    "opencv-python",
    "kornia-rs",
    "torch",
    "cupy-cuda12x",
    "cupy-cuda13x",
    "cucim-cu12",
    "cucim-cu13",
    "cvcuda-cu12",
    "cvcuda-cu13",
)


def surroundings(device: str, command: list[str]) -> dict[str, Any]:
    """Describe this machine and what is installed on it."""
    return {
        "date": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        "commit": _commit(),
        "command": " ".join(["python -m profiling", *_without_paths(command)]),
        "device": {"kind": device, "name": _gpu_name() if device == "cuda" else _cpu_model()},
        "host": {
            "cpu": _cpu_model(),
            "cores": cores(),
            "system": f"{platform.system()} {platform.machine()}",
            "threads": _threads(),
        },
        "versions": {"python": platform.python_version(), **_versions()},
    }


def write_json(path: Path, result: dict[str, Any]) -> None:
    """Write `result` to `path`, or leave what was there.

    Refuse results of code that no commit holds, which nobody could measure again; toy sizes are
    not results.
    """
    if is_dirty(result.get("commit", "")) and "--toy" not in result.get("command", "").split():
        raise ValueError(f"the tree must be a commit to record a result, got {result['commit']}")
    write_text(path, json.dumps(result, indent=1, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write beside `path`, then rename: a reader sees the old file or the new one."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise


def _without_paths(command: list[str]) -> list[str]:
    """Drop ``--json FILE``: where a result lies is no part of it."""
    kept, skip = [], False
    for word in command:
        if not skip and not word.startswith("--json="):
            kept.append(word)
        skip = word == "--json"
    return [word for word in kept if word != "--json"]


def is_dirty(commit: str) -> bool:
    """Return whether a tree had changes that no commit holds."""
    return commit.endswith("-dirty")


def _commit() -> str:
    """CVKERN_COMMIT, as told, where the tree came without its history, else what git says."""
    if given := os.environ.get("CVKERN_COMMIT"):
        return f"{given} as told"
    try:
        said = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return said.stdout.strip()


def _cpu_model() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _gpu_name() -> str:
    warp = importlib.import_module("warp")
    warp.init()
    return warp.get_device("cuda").name


def _threads() -> dict[str, int]:
    threads = {"cvkern": int(os.environ.get("CVKERN_NUM_THREADS") or cores())}
    with contextlib.suppress(ImportError):
        threads["cv2"] = importlib.import_module("cv2").getNumThreads()
    return threads


def _versions() -> dict[str, str]:
    found = {}
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found
