"""Compiled kernels on a disk that is full, broken or read-only."""

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from cvkern.app import doctor
from cvkern.kernels import _cache

ROOT = Path(__file__).parents[2]
# One small kernel of Warp compiles faster without its headers compiled first.
CALL = """
import os, sys, warnings
import numpy as np
import cvkern
if sys.argv[1] == "warp":
    import warp
    warp.config.use_precompiled_headers = False
with warnings.catch_warnings(record=True) as said, cvkern.use(sys.argv[1]):
    warnings.simplefilter("always", RuntimeWarning)
    image = 1 + np.eye(5, dtype="f4")
    total = sum(float(cvkern.disparity_to_depth(image, 1.0, 1.0).sum()) for _ in range(2))
said = [str(w.message) for w in said if w.category is RuntimeWarning]
print(round(total, 3), len(said), *said)
"""


def call(kernel_set, environment=None, *arguments, code=CALL):
    """Call two functions in a fresh process; return the sum, the warnings' number and text."""
    chosen = {**os.environ, **(environment or {})}
    done = subprocess.run(
        [sys.executable, "-c", code, kernel_set, *arguments],
        cwd=ROOT,
        env={key: value for key, value in chosen.items() if value is not None},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    total, count, said = f"{done.stdout.splitlines()[-1]} ".split(" ", 2)
    return float(total), int(count), said


CHOSEN = CALL.replace(
    "import cvkern\n",
    "import cvkern, warp\nwarp.init()\nwarp.config.kernel_cache_dir = sys.argv[2]\n",
    1,
)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A cache of each set that has the kernels of CALL; Warp's is chosen in Python."""
    folder = tmp_path_factory.mktemp("cache")
    places = {name: str(folder / name) for name in _cache.VARIABLES}
    environment = {_cache.VARIABLES[name]: place for name, place in places.items()}
    chosen = f"{places['warp']}/{version('warp-lang')}"  # Warp adds it to that of the variable
    found = [call("warp", None, chosen, code=CHOSEN), call("taichi", environment)]
    assert found[0] == found[1]
    assert found[0][1] == 0  # no warning
    return places, environment, found[0][0]


@pytest.fixture(scope="module")
def right(compiled):
    return compiled[-1]


@pytest.mark.parametrize("kernel_set", ["warp", "taichi"])
@pytest.mark.parametrize("by", ["home", "variable"])
def test_nowhere_to_write(kernel_set, by, tmp_path, right):
    """A folder below a file can no more be made than one on a disk for reading only."""
    file, variable = tmp_path / "file", _cache.VARIABLES[kernel_set]
    file.touch()
    environment: dict[str, str | None] = {"TMPDIR": str(tmp_path), variable: str(file / "cache")}
    if by == "home":
        environment.update({"HOME": str(file), "XDG_CACHE_HOME": None, variable: None})
    total, count, said = call(kernel_set, environment)
    assert total == right
    assert count == 1
    assert said.startswith(f"kernels cannot be kept in {file}")
    assert f"set {variable} to a writable folder" in said
    assert [path.name for path in tmp_path.iterdir() if "cvkern" in path.name] == []


def test_a_folder_that_is_for_reading_only(right):
    """Warp finds that out when it compiles: whatever the folder has already is used."""
    if not Path("/proc").is_dir():
        pytest.skip("needs /proc, where nobody can write")
    assert call("warp", None, "/proc", code=CHOSEN)[:2] == (right, 1)


@pytest.mark.parametrize(
    ("suffix", "left"), [(".o", 0.0), (".o", 0.5), (".meta", 0.5), (".tic", 0.5), (".tcb", 0.0)]
)
def test_a_broken_file_is_compiled_again(suffix, left, compiled, right):
    places, environment, _ = compiled
    name = "warp" if suffix in (".o", ".meta") else "taichi"
    files = sorted(Path(places[name]).rglob(f"*{suffix}"))
    assert files
    whole = {file: file.read_bytes() for file in files}
    assert doctor.cache_fault(name, places[name]) == ""
    for file, data in whole.items():
        file.write_bytes(data[: int(left * len(data))])
    if name == "warp" or left == 0:
        assert str(files[0].parent) in doctor.cache_fault(name, places[name])
    assert call(name, environment)[:2] == (right, 0)
    if name == "warp":  # and is whole again
        assert doctor.cache_fault(name, places[name]) == ""
        for file, data in whole.items():
            assert abs(file.stat().st_size - len(data)) < 64
    for file, data in whole.items():
        file.write_bytes(data)


def test_a_lock_of_a_killed_process_is_removed(compiled, right):
    """With it, no process would use the kernels, nor keep new ones."""
    places, environment, _ = compiled
    lock = Path(places["taichi"]) / "ticache.lock"
    lock.touch()
    _cache.unlock(lock)
    assert lock.exists()  # another process may be at work
    before = lock.stat().st_mtime - 2 * _cache.OLD
    os.utime(lock, (before, before))
    assert call("taichi", environment)[:2] == (right, 0)
    assert not lock.exists()


def test_the_doctor_names_the_variable(tmp_path):
    (tmp_path / "file").touch()
    for name, variable in _cache.VARIABLES.items():
        said = doctor.cache_fault(name, str(tmp_path / "file" / "cache"))
        assert said.startswith(f"nothing can be written in {tmp_path}")
        assert said.endswith(f"set {variable} to another folder")
