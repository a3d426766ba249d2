"""The fuzzer itself: that it calls all there is, sees what is wrong, and finds nothing today."""

import subprocess
import sys

import numpy as np
import pytest

import cvkern
from tests.fuzz import worker
from tests.fuzz.arguments import begin
from tests.fuzz.calls import CALLS, NOT_CALLED, Call, draw_call

FAMILIES = ("filters", "edges", "hough", "stereo")


def test_every_function_is_called():
    wanted = {
        name
        for family in FAMILIES
        for name in cvkern._NAMES[family]
        if not isinstance(getattr(cvkern, name), type)
    }
    assert wanted - NOT_CALLED <= {name.partition(" ")[0] for name in CALLS}


def test_a_call_is_known_by_its_seed_and_number():
    for index in range(30):
        (name, first), (again, second) = (draw_call(begin(5, index)) for _ in range(2))
        assert name == again
        assert worker.shown(first) == worker.shown(second)


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (lambda image: image.tolist()[99], "IndexError"),
        (lambda image: image.nothing, "AttributeError"),
        (lambda image: np.zeros(3) if cvkern._runtime._choice()[0] == "warp" else -np.zeros(3),
         "field 0 differs in 3"),
        (lambda image: image.fill(7), "the input image was written to"),
        (lambda image: image.astype("datetime64") + {}, "the message names no argument"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_seen(monkeypatch, function, said):
    monkeypatch.setitem(worker.CALLS, "wrong", Call(function, {}, {}))
    assert said in worker.fault_of("wrong", {"image": np.ones((4, 5))})


def test_a_small_budget_finds_nothing():
    """Half a thousand calls; CONTRIBUTING.md says how to make more."""
    words = [sys.executable, "-m", "tests.fuzz", "--calls", "500", "--seed", "1"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith("500 calls from 0 on with seed 1, 0 at fault\n")
