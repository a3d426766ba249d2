"""Compiling on several threads: before a call needs the kernels, and with one header."""

import importlib
import os
import shutil
import subprocess
import sys
import threading
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import cvkern
from cvkern import _ahead
from cvkern._runtime import choice
from cvkern.kernels._cache import MEANWHILE
from cvkern.kernels.warp import _launch
from cvkern.radiance import make_scene

ROOT = Path(__file__).parents[2]


def modules(call, monkeypatch):
    """Return Warp's modules that a call uses, and the families of their kernels."""
    used, failed, load = {}, [], _launch._load

    def seen(kernel, *place):
        used[kernel.module] = kernel.func.__module__.split(".")[3]
        load(kernel, *place)

    def work():  # on a new thread, which has no launches of earlier calls
        try:
            with cvkern.use("warp"):
                call()
        except Exception as error:
            failed.append(error)

    with monkeypatch.context() as patch:
        patch.setattr(_launch, "_load", seen)
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
    assert not failed
    return used


@pytest.fixture(scope="module")
def calls():
    """Calls of all functions that compile ahead, by name; K is known or not."""
    images = make_scene(layout="forward", train=4, test=0, size=160, texture=True).images
    views = np.rint(255 * images).astype(np.uint8)
    K = [[240, 0, 79.5], [0, 240, 79.5], [0, 0, 1]]
    panorama = importlib.import_module("cvkern.panorama._warmup").calls()
    return {
        "reconstruct": partial(cvkern.reconstruct, views, focal_lengths=240),
        "reconstruct freely": partial(cvkern.reconstruct, views),
        "reconstruct_pair": partial(cvkern.reconstruct_pair, *views[1:3], K),
        "reconstruct_pair freely": partial(cvkern.reconstruct_pair, *views[1:3]),
        **dict(reversed(list(panorama))),
    }


@pytest.mark.filterwarnings("ignore:the focal length is guessed")
@pytest.mark.parametrize(
    ("name", "own"),
    [
        ("reconstruct", set()),
        ("reconstruct freely", set()),
        ("reconstruct_pair", {"transform"}),
        ("reconstruct_pair freely", {"transform"}),
        ("match_photographs", {"transform"}),
        ("recognize_panoramas", set()),
        ("stitch", {"panorama"}),
    ],
)
def test_what_is_compiled_ahead_is_what_the_call_uses(name, own, calls, monkeypatch):
    """The call itself compiles its first stage, SIFT, and what else it has of families `own`."""
    named = []
    begun = _ahead._Others.__init__
    monkeypatch.setattr(
        _ahead._Others, "__init__", lambda self, n: named.append(n) or begun(self, n)
    )
    used = modules(calls[name], monkeypatch)
    (names,) = named
    known = modules(_ahead.warm_up_call("features.sift"), monkeypatch)
    for other in names:
        compiled = modules(_ahead.warm_up_call(other), monkeypatch)
        assert compiled.keys() <= used.keys(), other
        known |= compiled
    assert {used[module] for module in used.keys() - known.keys()} <= own


def test_the_others_begin_at_the_first_kernel_that_is_missing(monkeypatch):
    ran, go = [], threading.Event()

    def call(name):
        def work():
            go.wait()
            ran.append((name, choice(), threading.current_thread() is threading.main_thread()))
            if name == "bad":
                raise ValueError("the call that needs it will say so")

        return work

    monkeypatch.setattr(_ahead, "warm_up_call", call)
    monkeypatch.setattr(_ahead, "cpu_threads", lambda: 2)
    with _ahead.compiles_ahead("one"):
        pass
    assert not ran  # all kernels were there
    with cvkern.use("taichi"), _ahead.compiles_ahead("bad", "two"):
        with _ahead.compiles_ahead("inner"):
            begin = MEANWHILE.get()
            assert begin is not None
            begin()
            begin()
        assert not ran
        go.set()
    assert sorted(ran) == [("bad", ("taichi", "cpu"), False), ("two", ("taichi", "cpu"), False)]
    assert MEANWHILE.get() is None


# Two threads compile a module each.
PAIR = """
import threading
import numpy as np
import cvkern
image, totals = 1 + np.eye(5, dtype="f4"), [0.0, 0.0]
def first(): totals[0] = float(cvkern.disparity_to_depth(image, 1.0, 1.0).sum())
def second(): totals[1] = float(cvkern.left_right_check(image, image).sum())
threads = [threading.Thread(target=work) for work in (first, second)]
for thread in threads: thread.start()
for thread in threads: thread.join()
print(*totals)
"""


def test_threads_and_processes_share_one_header(tmp_path):
    def run():
        done = subprocess.run(
            [sys.executable, "-c", PAIR],
            cwd=ROOT,
            env={**os.environ, "WARP_CACHE_PATH": str(tmp_path), "TMPDIR": str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert "PCH" not in done.stderr
        return done.stdout

    expected = run()
    (header,) = tmp_path.rglob("*.pch")
    whole = header.read_bytes()
    # Zeros, which a machine without power may leave in a file; Clang crashes when it reads this.
    header.write_bytes(whole[:1_000_000] + bytes(1000) + whole[1_001_000:])
    for module in tmp_path.glob("*/wp_*"):
        if module != header.parent:
            shutil.rmtree(module)
    assert run() == expected != ""
    assert [header] == [*tmp_path.rglob("*.pch")]
    assert header.read_bytes()[1_000_000:1_001_000] == whole[1_000_000:1_001_000]
