"""The fuzzer itself: that it calls all there is, sees what is wrong, and finds nothing today."""

import argparse
import inspect
import subprocess
import sys

import numpy as np
import pytest

import cvkern
from tests.fuzz import processes, worker
from tests.fuzz.__main__ import Work
from tests.fuzz.arguments import Call, begin
from tests.fuzz.families import CALLS, NOT_CALLED, draw_call, models, parts, turns


def public_functions():
    """Yield the public functions, those of namespaces with a prefix."""
    for family in cvkern._NAMES:
        yield from (name for name in cvkern._NAMES[family] if is_function(getattr(cvkern, name)))
    for space in cvkern._NAMESPACES:
        module = getattr(cvkern, space)
        yield from (f"{space}.{n}" for n in module.__all__ if is_function(getattr(module, n)))


def is_function(found):
    return callable(found) and not isinstance(found, type)


def test_every_function_is_called():
    """One that is not called is excused by name, with the reason."""
    called = {name.partition(" ")[0] for name in CALLS}
    assert set(public_functions()) - called == set(NOT_CALLED)
    assert called - set(public_functions()) <= set(cvkern.__all__)  # classes


def test_options_are_those_of_the_function():
    """An option by another name would only ever be refused."""
    for name, call in CALLS.items():
        parameters = inspect.signature(call.function).parameters
        if all(p.kind != p.VAR_KEYWORD for p in parameters.values()):
            assert {*call.needed, *call.options} <= set(parameters), name


@pytest.mark.filterwarnings("ignore")  # the worker ignores them too
def test_a_call_is_known_by_its_seed_and_number(monkeypatch):
    monkeypatch.setattr(models, "model_file", lambda: bytes(99))  # it would be trained first
    for index in range(len(CALLS)):
        (name, first), (again, second) = (draw_call(begin(5, index), index) for _ in range(2))
        assert name == again
        assert worker.shown(first) == worker.shown(second)


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (lambda image: image.tolist()[99], "IndexError"),
        (lambda image: image.nothing, "AttributeError"),
        (lambda image: np.zeros(3) if cvkern._runtime.choice()[0] == "warp" else -np.zeros(3),
         "differs in 3"),
        (lambda image: image.fill(7), "the input image was written to"),
        (lambda image: image.astype("datetime64") + {}, "the message names no argument"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_seen(monkeypatch, function, said):
    monkeypatch.setitem(worker.CALLS, "wrong", Call(function, {}, {}))
    assert said in worker.fault_of("wrong", {"image": np.ones((4, 5))})


@pytest.mark.parametrize(("family", "calls"), [("filters", 40), ("images", 60)])
def test_a_small_budget_finds_nothing(family, calls):
    """A few calls of families that compile little; CONTRIBUTING.md says how to make more."""
    words = [sys.executable, "-m", "tests.fuzz", "--family", family, "--calls", str(calls)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith(f"{calls} calls from 0 on with seed 0, 0 at fault\n")


def test_a_million_calls_are_thousands_of_each_function():
    """So does docs/built.md say, whatever time they take."""
    order = turns("")
    assert set(order) == set(CALLS)
    shares = [order.count(name) * 10**6 / len(order) for name in CALLS]
    assert 1900 < min(shares) < max(shares) < 5100


def test_parts_are_all_calls():
    """Each call belongs to one part, and processes that go through all parts make all calls."""
    for family in ("", "filters"):
        part_of = parts(family, 7)
        assert set(turns(family)) <= set(part_of)
        counts = np.bincount([part_of[name] for name in turns(family)], minlength=7)
        assert len(counts) == 7
        assert counts.min() > 0
    work = Work(argparse.Namespace(first=5, calls=1000, workers=3, minutes=None))
    made = {part: [] for part in range(3)}
    while (chunk := work.take(1)) is not None:  # the others are behind, and get help at last
        made[chunk.part] += range(chunk.first, chunk.stop)
    assert all(made[part] == list(range(5, 1005)) for part in range(3))


def test_a_process_that_dies_or_hangs_is_replaced(monkeypatch):
    """What goes on is the call behind the one that was at work."""
    work = "import os, sys, time; log = os.fdopen(int(sys.argv[4]), 'w', buffering=1)\n"
    script = work + (
        "for line in sys.stdin:\n"
        "    for n in range(*map(int, line.split()[:2])):\n"
        "        print('{\"begin\": %d}' % n, file=log)\n"
        "        if n == 2: os.abort()\n"
        "        if n == 4: time.sleep(60)\n"
        '    print(\'{"end": 6, "peak": 7}\', file=log)\n'
    )
    monkeypatch.setattr(processes, "PATIENCE", 2.0)
    monkeypatch.setattr(processes, "WORKER", ["-c", script])
    process, faults, at = processes.Process(0, "cpu", 1), [], 0
    while at < 6:
        at, _, _ = process.make(processes.Chunk(at, 6), faults.append)
    process.close()
    assert [fault["call"] for fault in faults] == [2, 4]
    assert "ended with -6" in faults[0]["fault"]
    assert faults[1]["fault"] == "no answer in time"
