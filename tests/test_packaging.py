"""The installed files, the cost of importing them, and imports that must not happen."""

import configparser
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

import cvkern

ROOT = Path(__file__).parents[1]
HEAVY = {"warp", "taichi", "torch", "scipy", "imageio", "typer", "rich", "skimage", "cv2", "jax"}


def run(code, folder=ROOT, **environment):
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def modules(folder):
    """Return the files that an installation must have, by their paths in it."""
    names = {
        f"cvkern/{path.relative_to(folder / 'cvkern')}"
        for path in (folder / "cvkern").glob("**/*.py")
        if "kernels" not in path.relative_to(folder).parts
    }
    kernels = (path for kind in ("py", "cu", "h") for path in folder.glob(f"kernels/**/*.{kind}"))
    return names | {f"cvkern/{path.relative_to(folder)}" for path in kernels}


# --- import --------------------------------------------------------------------------------------


def test_import_is_light():
    """No framework, nothing but NumPy and the standard library, and few modules of our own."""
    done = run(
        "import sys, numpy; before = set(sys.modules); import cvkern\n"
        "added = set(sys.modules) - before\n"
        "print(*sorted({m.partition('.')[0] for m in added} - set(sys.stdlib_module_names)))\n"
        "print(len(added)); print(*sorted(sys.modules))"
    )
    others, count, loaded = done.stdout.splitlines()
    assert others == "cvkern"
    assert not HEAVY & set(loaded.split())
    assert int(count) < 60


def test_families_import_no_framework():
    modules = ["images", "clouds", *(name for name in cvkern._NAMES if name[0] != "_")]
    done = run(
        "import importlib, sys\n"
        f"for name in {modules}:\n"
        "    importlib.import_module(f'cvkern.{name}')\n"
        f"    print(name, *sorted({HEAVY} & set(sys.modules)))"
    )
    assert done.stdout.splitlines() == modules


def test_one_kernel_set_does_not_bring_the_other():
    for name, other in (("warp", "taichi"), ("taichi", "warp")):
        done = run(
            "import sys, numpy, cvkern; cvkern.canny(numpy.eye(4)); print(*sys.modules)",
            CVKERN_BACKEND=name,
        )
        loaded = set(done.stdout.split())
        assert name in loaded, done.stderr
        assert other not in loaded


def test_the_bare_name_kernels_is_refused():
    done = run("import kernels")
    assert done.returncode == 1
    assert (
        "ImportError: import cvkern.kernels; the bare name 'kernels' belongs to another project"
        in done.stderr
    )
    done = run("import cvkern.kernels.codes.filters as codes; print(codes.Border.WRAP.name)")
    assert done.stdout == "WRAP\n"


# --- pyproject.toml ------------------------------------------------------------------------------


def test_the_version_is_said_once_more():
    tomllib = pytest.importorskip("tomllib")  # Python 3.11
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["project"]["version"] == cvkern.__version__


def test_kernels_are_a_link_in_the_tree():
    link = ROOT / "cvkern" / "kernels"
    if not link.is_symlink():
        pytest.skip("installed, not a checkout")
    assert os.readlink(link) == "../kernels"


# --- wheel and sdist -----------------------------------------------------------------------------


def build(tree, what, out):
    """Build a wheel or an sdist from `tree` as pip would; return the file."""
    code = f"from setuptools import build_meta; print(build_meta.build_{what}({str(out)!r}))"
    done = run(code, tree)
    assert done.returncode == 0, done.stderr
    return out / done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A wheel and an sdist of a copy of the tree: building leaves files behind."""
    pytest.importorskip("setuptools", minversion="77")
    folder = tmp_path_factory.mktemp("built")
    tree = folder / "tree"
    tree.mkdir()
    for name in ("cvkern", "kernels"):
        shutil.copytree(
            ROOT / name, tree / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tree)
    return build(tree, "wheel", folder), build(tree, "sdist", folder)


def wheel_files(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return {name for name in archive.namelist() if ".dist-info/" not in name}


def test_the_wheel_holds_every_module_and_nothing_else(built):
    wheel, _ = built
    data = {file.relative_to(ROOT).as_posix() for file in (ROOT / "cvkern").glob("*/data/*")}
    rest = data | {"cvkern/py.typed", "cvkern/_kernels.pyi"}
    assert wheel_files(wheel) == modules(ROOT) | rest


def test_the_wheels_metadata(built):
    wheel, _ = built
    info = f"cvkern-{cvkern.__version__}.dist-info"
    with zipfile.ZipFile(wheel) as archive:
        metadata = archive.read(f"{info}/METADATA").decode()
        scripts = configparser.ConfigParser()
        scripts.read_string(archive.read(f"{info}/entry_points.txt").decode())
        top_level = archive.read(f"{info}/top_level.txt").decode().split()
        assert archive.read(f"{info}/licenses/LICENSE") == (ROOT / "LICENSE").read_bytes()
    assert scripts["console_scripts"]["cvkern"] == "cvkern.app.cli:main"
    assert top_level == ["cvkern"]  # never the global name of another project
    assert re.search(rf"^Version: {re.escape(cvkern.__version__)}$", metadata, re.MULTILINE)
    assert re.search(r"^License-Expression: Apache-2.0$", metadata, re.MULTILINE)
    assert re.search(r'^Requires-Dist: taichi.*; python_version < "3.14"$', metadata, re.MULTILINE)


def test_the_sdist_builds_the_same_wheel(built, tmp_path):
    wheel, sdist = built
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    (tree,) = tmp_path.iterdir()
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE", "kernels/codes/filters.py"):
        assert (tree / name).is_file(), name
    assert wheel_files(build(tree, "wheel", tmp_path)) == wheel_files(wheel)


def test_the_wheel_works_away_from_the_tree(built, tmp_path):
    wheel, _ = built
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    code = (
        "import numpy, cvkern; print(cvkern.__file__)\n"
        "for name in ('warp', 'taichi'):\n"
        "    with cvkern.use(name):\n"
        "        print(int(cvkern.canny(numpy.eye(9) > 0, 1.0).sum()))"
    )
    done = run(code, tmp_path, PYTHONPATH=str(tmp_path / "site"))
    where, *counts = done.stdout.splitlines() or [done.stderr]
    assert Path(where) == tmp_path / "site" / "cvkern" / "__init__.py"
    assert len(counts) == 2
    assert counts[0] == counts[1] != "0"
