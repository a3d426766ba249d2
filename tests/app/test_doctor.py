"""``cvkern doctor`` and ``cvkern warmup``."""

import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cvkern
from cvkern.app import doctor, warmup
from cvkern.kernels.warp import _launch
from tests.calls import CALLS, blobs


def test_warmup_calls_everything():
    without = {"capture", "devices", "release_memory"}
    for family in Path(cvkern.__file__).parent.glob("*/_warmup.py"):
        module = importlib.import_module(f"cvkern.{family.parent.name}._warmup")
        without.update(getattr(module, "NO_KERNELS", ()))
    assert without <= set(cvkern.__all__)
    functions = {n for n in cvkern.__all__ if inspect.isfunction(getattr(cvkern, n))} - without
    called = {name for name, _ in warmup.calls()}
    others = {
        "ShapeModel", "composite_rays", "composite_rays_backward", "fit", "make_scene",
        "planes_from_depth", "positional_encoding", "spherical_harmonics", "turntable",
    }  # fmt: skip
    assert called == functions | others


def test_warmup(command, monkeypatch):
    called = []
    names = ("one", "two")
    calls = [(name, lambda name=name: called.append(name)) for name in names]
    monkeypatch.setattr(warmup, "calls", lambda: iter(calls))
    code, out, _ = command("warmup")
    assert (code, out) == (0, "All kernels are compiled.\n")
    assert sorted(called) == ["one", "two"]


def test_warmup_leaves_nothing_to_compile():
    """Warp's modules, for the calls of the tests, of a photograph's dtypes."""
    with cvkern.use(backend="warp"):
        for _, call in warmup.calls():
            call()
        warm = {kernel.module for kernel, *_ in _launch._loaded}
        for name, call in CALLS.items():
            for dtype in ("uint8", "float32"):
                call(blobs(25, 41).astype(dtype))
                late = {kernel.module for kernel, *_ in _launch._loaded} - warm
                assert not late, (name, dtype)


def test_every_function_works_with_taichi():
    """In a warm-up call; the tests of each family make calls of further dtypes."""
    firsts = dict(reversed(list(warmup.calls())))
    with cvkern.use(backend="taichi"):
        for call in firsts.values():
            call()


def test_doctor(command):
    code, out, _ = command("doctor")
    assert code == 0, out
    assert cvkern.__version__ in out
    assert out.count("right") >= 4
    assert "Kernel cache of warp" in out
    assert "Kernel cache of taichi" in out


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        ({"wrong": {"gaussian": "", "canny": "3 of 9 pixels are wrong"}}, 1),
        ({"wrong": {"process": "no answer within 600 s"}}, 1),
        ({"absent": "device must be one that is there"}, 0),
        ({"wrong": {"gaussian": "", "canny": ""}}, 0),
    ],
)
def test_doctor_tells_what_is_wrong(command, monkeypatch, fault, code):
    healthy = {"gaussian": "", "canny": ""}

    def examine(backend, device):
        sick = device == "cuda" if "absent" in fault else backend == "taichi"
        finding = doctor.Finding(backend, device)
        finding.absent = fault.get("absent", "") if sick else ""
        finding.wrong = fault.get("wrong", {}) if sick else healthy
        return finding

    monkeypatch.setattr(doctor, "examine", examine)
    found, out, _ = command("doctor")
    assert found == code
    for said in (fault.get("absent"), *fault.get("wrong", {}).values()):
        assert (said or "") in out


def test_doctor_sees_wrong_answers(monkeypatch):
    assert doctor.gaussian() == ""
    assert doctor.canny() == ""
    right = cvkern.gaussian
    monkeypatch.setattr(cvkern, "gaussian", lambda *a, **k: right(*a, **k) + np.float32(1e-3))
    assert "differs from SciPy by 0.001" in doctor.gaussian()
    mask = cvkern.canny
    monkeypatch.setattr(cvkern, "canny", lambda *a, **k: ~mask(*a, **k))
    assert "pixels are wrong" in doctor.canny()


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("import os; os.abort()", "ended with code"),
        ("import sys; sys.exit('the driver is broken')", "the driver is broken"),
        ("print('not JSON')", "ended with code 0"),
        ("import time; time.sleep(60)", "no answer within 1 s"),
    ],
)
def test_doctor_survives_the_patient(monkeypatch, program, said):
    run = subprocess.run
    monkeypatch.setattr(
        subprocess, "run", lambda command, **options: run([command[0], "-c", program], **options)
    )
    finding = doctor.examine("warp", "cpu", timeout=1)
    assert not finding.healthy
    assert said in finding.wrong["process"]


def test_the_command_starts_fast():
    heavy = ("warp", "taichi", "scipy", "imageio", "tifffile", "skimage", "rich")
    code = f"import sys, cvkern.app.cli; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
