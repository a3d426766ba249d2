"""One process of the fuzzer: it writes down each call before it makes it."""

from __future__ import annotations

import copy
import json
import re
import sys
import traceback
import warnings
from typing import Any

import numpy as np

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.fuzz.arguments import begin
from tests.fuzz.calls import CALLS, draw_call

ALLOWED = (ValueError, TypeError)
SHARED = {"arrays", "votes", "out"}  # what messages may be about, but for arguments


def answer(name: str, backend: str, arguments: dict[str, Any]) -> Any:
    """Return what a call gives, or the exception that leaves it."""
    with cvkern.use(backend=backend), warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "no edge was found")
        try:
            return CALLS[name].function(**arguments)
        except Exception as error:
            return error


def fault_of(name: str, arguments: dict[str, Any]) -> str:
    """Make a call with either kernel set; return what was wrong with that, or nothing."""
    before = copy.deepcopy({k: v for k, v in arguments.items() if isinstance(v, np.ndarray)})
    answers = [answer(name, backend, arguments) for backend in KERNEL_SETS]
    for key, value in before.items():
        if not np.array_equal(value, arguments[key], equal_nan=value.dtype.kind in "fc"):
            return f"the input {key} was written to"
    for backend, got in zip(KERNEL_SETS, answers, strict=True):
        if isinstance(got, Exception):
            if not isinstance(got, ALLOWED):
                where = "".join(traceback.format_exception(got)[-2:])
                return f"{backend}: {type(got).__name__}: {got} {where}"
            said = set(re.findall(r"\w+", str(got)))
            if not said & (set(CALLS[name].needed) | set(CALLS[name].options) | SHARED):
                return f"{backend}: the message names no argument: {type(got).__name__}: {got}"
    first, second = answers
    if isinstance(first, Exception) or isinstance(second, Exception):
        if type(first) is not type(second) or str(first) != str(second):
            return f"the sets differ: {first!r} and {second!r}"
        return ""
    return differ(first, second) if CALLS[name].equal else ""


def differ(first: Any, second: Any) -> str:
    """Return how two answers differ in any bit, or nothing; all NaN are one."""
    pairs = zip(first, second, strict=True) if isinstance(first, tuple) else [(first, second)]
    for i, (a, b) in enumerate(pairs):
        a, b = np.asarray(a), np.asarray(b)
        if a.shape != b.shape or a.dtype != b.dtype:
            return f"field {i}: {a.shape} {a.dtype} and {b.shape} {b.dtype}"
        if a.dtype.kind == "f":
            same = (a == b) & (np.signbit(a) == np.signbit(b)) | (np.isnan(a) & np.isnan(b))
        else:
            same = a == b
        if not np.all(same):
            at = np.argwhere(~np.atleast_1d(same))[0]
            where = tuple(int(n) for n in at)
            values = np.atleast_1d(a)[where], np.atleast_1d(b)[where]
            return f"field {i} differs in {int((~same).sum())}, first at {where}: {values}"
    return ""


def shown(arguments: dict[str, Any]) -> str:
    """Return arguments in few words."""
    said = []
    for key, value in arguments.items():
        if isinstance(value, np.ndarray) and value.size > 9:
            said.append(f"{key}=array{value.shape} {value.dtype}")
        else:
            said.append(f"{key}={str(value)[:60]}")
    return ", ".join(said)


def main() -> None:
    """Make the calls that the command names."""
    seed, first, stop = map(int, sys.argv[1:4])
    with open(sys.argv[4], "a", buffering=1) as log:
        for index in range(first, stop):
            log.write(json.dumps({"begin": index}) + "\n")
            name, arguments = draw_call(begin(seed, index))
            fault = fault_of(name, arguments)
            if fault:
                said = {"call": index, "seed": seed, "fault": fault[:900], "name": name}
                log.write(json.dumps({**said, "arguments": shown(arguments)[:600]}) + "\n")
        log.write(json.dumps({"end": stop}) + "\n")


if __name__ == "__main__":
    main()
