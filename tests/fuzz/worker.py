"""One process of the fuzzer: it says which call it makes before it makes it.

It is given the seed, a device, a family or nothing, and the number of a pipe to write to. It reads
lines that name chunks of calls, makes these, and writes a line of JSON for each that begins, each
that is at fault, and the end.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import resource
import sys
import time
import traceback
import warnings
from typing import Any

import numpy as np

import cvkern
from cvkern._runtime import KERNEL_SETS
from cvkern.filters.gradients import Gradient
from cvkern.kernels.taichi._denormals import can_keep_denormals
from tests.fuzz.arguments import begin
from tests.fuzz.disguises import Frame, Once
from tests.fuzz.families import CALLS, draw_call, name_of, parts

ALLOWED = (ValueError, TypeError)
# What messages may be about, apart from the arguments of the call.
SHARED = {"arrays", "votes", "out", "path", "channel_axis", "points0", "points1"}
# Three calls in four are drawn again, up to so often, until Warp does not refuse the arguments.
TRIES = 6
AGAIN = 8  # one call in so many is made again, with arrays laid out plainly
MOST_MEMORY = 1 << 20  # KiB that one call may add to the peak; images have at most 130 x 130 pixels
DENORMAL = 2.0**-126  # float32 begins to lose digits below it, and Taichi takes less for zero
TINY = 1e-18  # roots of some numbers that are denormal in float32, added
SLOW = 20.0  # seconds of work of one call when nothing is compiled: far beyond what any takes


def contestants(device: str) -> list[tuple[str, str]]:
    """Return the kernel sets and devices whose answers are compared."""
    found = [(backend, "cpu") for backend in KERNEL_SETS]
    if device == "cpu":
        return found
    return [("warp", "cpu"), *((backend, device) for backend in KERNEL_SETS)]


def answer(name: str, backend: str, device: str, arguments: dict[str, Any]) -> Any:
    """Return the result of a call, or its exception."""
    with cvkern.use(backend=backend, device=device), warnings.catch_warnings():
        warnings.simplefilter("error")
        # Documented warnings.
        for said in (
            "no (edge|keypoint|line|phase|code|normal) was found",
            "the focal length is",
            ".*of the cameras look past the scene's cube",
        ):
            warnings.filterwarnings("ignore", said)
        warnings.filterwarnings("ignore", module="skimage")
        try:
            return CALLS[name].function(**arguments)
        except Exception as error:
            return error


class Refused(Exception):
    """The first kernel set refuses the arguments, as it should."""


def fault_of(
    name: str, arguments: dict[str, Any], device: str = "cpu", again: bool = True,
    seeking: bool = False,
) -> str:  # fmt: skip
    """Make a call in every way; return what was wrong with that, or nothing.

    If an answer is sought, raise :class:`Refused` where there is none.
    """
    out = arguments.get("out")
    arrays = {k: v for k, v in arguments.items() if isinstance(v, np.ndarray) and k != "out"}
    before = {k: v.copy() for k, v in arrays.items() if v.dtype != object}
    again |= any(is_disguised(value) for value in arguments.values())
    ways = contestants(device)
    answers = []
    for backend, place in ways:
        got = answer(name, backend, place, arguments)
        if seeking and isinstance(got, ALLOWED) and not wrong_error(name, got):
            raise Refused
        answers.append(got.copy() if got is out and isinstance(got, np.ndarray) else got)
    for key, value in before.items():
        if differ(value, arguments[key]):
            return f"the input {key} was written to"
    for (backend, _), got in zip(ways, answers, strict=True):
        if wrong := wrong_error(name, got):
            return f"{backend}: {wrong}"
    first = answers[0]
    for (backend, place), other in zip(ways[1:], answers[1:], strict=True):
        if isinstance(first, Exception) or isinstance(other, Exception):
            if type(first) is not type(other) or str(first) != str(other):
                return f"the sets differ: {first!r} and {backend} on {place} {other!r}"
        elif CALLS[name].equal in (True, device) and not CALLS[name].but(arguments):
            flushed = place != "cpu" or not can_keep_denormals()
            wrong = differ(first, other, flushed)
            if wrong:
                return f"{backend} on {place}: {wrong}"
    if isinstance(first, Exception):
        return ""
    if any(isinstance(v, np.ma.MaskedArray) and np.any(v.mask) for v in arguments.values()):
        return "a mask was ignored"
    if again:
        plain = {k: plainly(v) if k != "out" else v for k, v in arguments.items()}
        if wrong := differ(first, answer(name, *ways[0], plain)):
            return f"another answer with arrays laid out plainly: {wrong}"
    return ""


def wrong_error(name: str, got: Any) -> str:
    """Return the fault of an exception, or an empty text."""
    if not isinstance(got, Exception):
        return ""
    documented = type(got).__name__ in (CALLS[name].function.__doc__ or "")
    if not isinstance(got, ALLOWED) and not documented:
        where = "".join(traceback.format_exception(got)[-2:])
        return f"{type(got).__name__}: {got} {where}"
    said = set(re.findall(r"\w+", str(got)))
    if not said & (set(CALLS[name].needed) | set(CALLS[name].options) | SHARED):
        return f"the message names no argument: {type(got).__name__}: {got}"
    return ""


def is_disguised(value: Any) -> bool:
    """Tell whether an argument holds its values in an uncommon way."""
    if isinstance(value, np.ndarray):
        return type(value) is not np.ndarray or not value.flags.aligned
    if type(value) in (list, tuple):
        return any(is_disguised(item) for item in value)
    return isinstance(value, (Frame, Once, memoryview))


def plainly(value: Any) -> Any:
    """Return a new array of the same values, in native order and without gaps."""
    if isinstance(value, (Frame, memoryview)):
        value = np.asarray(value)
    if isinstance(value, Once) or type(value) in (list, tuple):
        return (tuple if type(value) is tuple else list)(plainly(item) for item in value)
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "biufc":
        return value
    return np.array(value, value.dtype.newbyteorder("="), order="C")


def differ(first: Any, second: Any, flushed: bool = False) -> str:
    """Return how two answers differ in any bit, or nothing; all NaN are one.

    `flushed` tells that the second was computed with 0 for denormal numbers.
    """
    if isinstance(first, Exception) or isinstance(second, Exception):
        return f"{first!r} and {second!r}"
    if first is None or second is None or isinstance(first, (bytes, str, int)):
        return "" if first is second or first == second else f"{first!r} and {second!r}"
    if flushed and isinstance(first, Gradient) and isinstance(second, Gradient):
        first, second = (turned_from_denormals(slopes, first) for slopes in (first, second))
    if isinstance(first, (tuple, list)):
        if len(first) != len(second):
            return f"{len(first)} and {len(second)} fields"
        found = (differ(a, b, flushed) for a, b in zip(first, second, strict=True))
        return next((f"field {i}: {said}" for i, said in enumerate(found) if said), "")
    if hasattr(first, "__dataclass_fields__"):
        return differ(list(vars(first).values()), list(vars(second).values()), flushed)
    a, b = (plainly(np.asarray(values)) for values in (first, second))
    if a.shape != b.shape or a.dtype != b.dtype:
        return f"{a.shape} {a.dtype} and {b.shape} {b.dtype}"
    if a.dtype.kind == "f":
        same = (a == b) & (np.signbit(a) == np.signbit(b)) | (np.isnan(a) & np.isnan(b))
        if flushed:
            same |= lost_denormals(a, b)
    else:
        same = a == b
    if np.all(same):
        return ""
    where = tuple(int(n) for n in np.argwhere(~np.atleast_1d(same))[0])
    values = np.atleast_1d(a)[where], np.atleast_1d(b)[where]
    return f"differs in {int((~same).sum())} of {a.size}, first at {where}: {values}"


def lost_denormals(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Tell where numbers differ by no more than denormal squares or weights."""
    with np.errstate(all="ignore"):
        apart = np.abs(a.astype(np.float64) - b)
        largest = np.max(np.abs(a), initial=0, where=np.isfinite(a))
    return (apart > 0) & ((apart < TINY) | (apart <= DENORMAL * largest))


def turned_from_denormals(slopes: Gradient, by: Gradient) -> tuple[np.ndarray, ...]:
    """Return slopes with the orientation 0 where a derivative, of those in `by`, is denormal."""
    parts = [np.abs(np.asarray(part)) for part in (by.dy, by.dx)]
    lost = np.any([(part > 0) & (part < DENORMAL) for part in parts], axis=0)
    return *slopes[:3], np.where(lost, np.float32(0), slopes.orientation)


def shown(arguments: dict[str, Any]) -> str:
    """Return arguments in few words."""
    said = []
    for key, value in arguments.items():
        if isinstance(value, memoryview):
            value = Frame(np.asarray(value))
        if isinstance(value, np.ndarray) and value.size > 9:
            said.append(f"{key}=array{value.shape} {value.dtype}")
        else:
            said.append(f"{key}={str(value)[:60]}")
    return ", ".join(said)


def peak() -> int:
    """Return the largest memory that this process has had, in KiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def make(seed: int, index: int, device: str, family: str) -> dict[str, Any]:
    """Make one call; return what was at fault, if anything was."""
    draw = begin(seed, index)
    sought, again = draw.salt % 4 > 0, draw.salt % AGAIN == 0
    for left in reversed(range(TRIES if sought else 1)):
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            name, arguments = draw_call(draw, index, family)
        with contextlib.suppress(Refused):
            fault = timed(name, arguments, device, again, left > 0)
            if fault:
                said = {"fault": fault[:900], "arguments": shown(arguments)[:600]}
                return {"call": index, "name": name, **said}
            break
        draw = draw._replace(salt=int(draw.rng.integers(2**31)))
    return {}


def timed(name: str, arguments: dict[str, Any], device: str, again: bool, seeking: bool) -> str:
    """Return the fault of a call, of its memory, or of its time."""
    held, since = peak(), time.process_time()
    fault = fault_of(name, arguments, device, again, seeking)
    grown, took = peak() - held, time.process_time() - since
    if not fault and grown > MOST_MEMORY and device == "cpu":
        fault = f"it took {grown >> 10} MiB"
    if not fault and took > SLOW:
        before = time.process_time()
        fault_of(name, arguments, device, again=False)
        repeated = time.process_time() - before
        fault = f"it took {repeated:.0f} s when nothing was compiled" if repeated > SLOW else ""
    return fault


def main() -> None:
    """Make the calls that the lines of the input name."""
    seed, device, family, pipe = int(sys.argv[1]), sys.argv[2], sys.argv[3], int(sys.argv[4])
    with os.fdopen(pipe, "w", buffering=1) as log:
        for line in sys.stdin:
            first, stop, part, count = map(int, line.split())
            part_of = parts(family, count)
            for index in range(first, stop):
                if part_of[name_of(index, family)] != part:
                    continue
                log.write(f'{{"begin": {index}}}\n')
                with contextlib.suppress(KeyboardInterrupt):
                    if fault := make(seed, index, device, family):
                        log.write(json.dumps(fault) + "\n")
            log.write(json.dumps({"end": stop, "peak": peak()}) + "\n")


if __name__ == "__main__":
    main()
