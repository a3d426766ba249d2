"""Check one case, then time cvkern and its peers in turns."""

from __future__ import annotations

import importlib
import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

import cvkern

from .arrays import carrier, fields, load
from .case import Case, CheckFailedError, Inputs, Peer, Shape
from .clock import HostClock

CACHE_BYTES = 128 << 20  # more than the last cache of any device here holds
SAMPLE_SECONDS = 0.01  # one sample is as many calls as last this long
ROUNDS = 15
FEWEST_ROUNDS = 3
BUDGET_SECONDS = 4.0  # a contender that has had this much and the fewest rounds sits out
MOST_CALLS = 1000


Answer = tuple[np.ndarray, ...]


@dataclass
class Contender:
    """One way to compute the case, ready to be called on each of the inputs in turn."""

    name: str
    calls: Sequence[Callable[[], Any]]
    about: dict[str, Any]
    samples: list[float] = field(default_factory=list)
    spent: float = 0.0
    count: int = 1
    turn: Iterator[Callable[[], Any]] = field(init=False)

    def __post_init__(self) -> None:
        self.turn = itertools.cycle(self.calls)

    def sample(self, clock: HostClock) -> float:
        seconds = clock.seconds(self.turn, self.count)
        self.spent += seconds * self.count
        return seconds

    @property
    def done(self) -> bool:
        return self.spent > BUDGET_SECONDS and len(self.samples) >= FEWEST_ROUNDS


@dataclass(frozen=True)
class Bench:
    """Where and how a run measures."""

    device: str
    backend: str
    clock: HostClock
    rng: np.random.Generator
    copy_bandwidth: float  # bytes a second
    toy: bool = False

    @property
    def rounds(self) -> int:
        return 2 if self.toy else ROUNDS

    def run(self, case: Case, shape: Shape) -> dict[str, Any]:
        """Check and time one case; raise CheckFailedError on a wrong answer."""
        moved = case.bytes_per_pixel * math.prod(shape)
        # Enough inputs to overflow the caches: over one, repeated calls measure the cache.
        sets = 1 if self.toy else min(case.most_inputs, math.ceil(CACHE_BYTES / max(moved, 1)))
        images = [case.inputs(shape, self.rng) for _ in range(sets)]
        right = fields(case.oracle(*images[0]))
        # The work of the first: the others are of the same kind, and do as much to a percent.
        count = None if case.work is None else float(case.work.count(*images[0]))

        array_type = carrier() if self.device == "cuda" else "numpy"
        arrays = [_load(inputs, array_type, self.device) for inputs in images]
        ours = self._cvkern(case, arrays, right)
        ours.about["arrays"] = array_type
        contenders, missing = [ours], []
        if self.device == "cuda" and case.captures:
            self._add(
                contenders, missing, "cvkern, graph", lambda: self._graph(case, arrays, right)
            )
        for peer in case.peers:
            if peer.device == self.device:
                self._add(
                    contenders,
                    missing,
                    peer.name,
                    lambda p=peer: self._peer(case, p, images, right),
                )
        self._time(contenders)
        base = float(np.median(ours.samples))
        return {
            "case": case.name,
            "title": case.title,
            "shape": list(shape),
            "dtype": str(images[0][0].dtype),
            "inputs": sets,
            "bytes": moved,
            "operations": case.operations_per_pixel * math.prod(shape),
            **({"work": {"unit": case.work.unit, "count": count}} if case.work else {}),
            "oracle": case.oracle_name,
            "tolerance": case.tolerance,
            "contenders": [self._record(c, moved, count, base) for c in contenders] + missing,
        }

    def _cvkern(self, case: Case, arrays: list[Inputs], right: Answer) -> Contender:
        contender = Contender("cvkern", [partial(case.call, *a) for a in arrays], {})
        answer = self._first(contender)  # compiles, or loads what an earlier run compiled
        contender.about["difference"] = case.check(answer, right)
        return contender

    def _graph(self, case: Case, arrays: list[Inputs], right: Answer) -> Contender:
        """Give the captured call, one for each input: its replay must be right as well."""
        begin = time.perf_counter()
        contender = Contender("cvkern, graph", [cvkern.capture(case.call, *a) for a in arrays], {})
        contender.about["capture_s"] = time.perf_counter() - begin
        answer = self._first(contender)
        contender.about["difference"] = case.check(answer, right)
        return contender

    def _peer(self, case: Case, peer: Peer, images: list[Inputs], right: Answer) -> Contender:
        module = importlib.import_module(peer.module)
        arrays = [_load(inputs, peer.module, peer.device) for inputs in images]
        contender = Contender(peer.name, [partial(peer.call, module, *a) for a in arrays], {})
        answer = self._first(contender)
        found = case.compare(answer, right)
        if not math.isfinite(found):
            raise ValueError("its answer has another shape, or NaN")
        contender.about |= {"difference": found, "same": found <= case.tolerance}
        if peer.note:
            contender.about["note"] = peer.note
        return contender

    def _first(self, contender: Contender) -> Any:
        begin = time.perf_counter()
        answer = contender.calls[0]()
        self.clock.synchronize()
        contender.about["first_call_s"] = time.perf_counter() - begin
        return answer

    def _add(
        self, ready: list[Contender], missing: list[dict[str, Any]], name: str, make: Callable
    ) -> None:
        """Make a contender, or record why there is none."""
        try:
            ready.append(make())
        except (KeyboardInterrupt, SystemExit, CheckFailedError):
            raise
        except ImportError as error:
            missing.append({"name": name, "status": "absent", "reason": _one_line(error)})
        except BaseException as error:  # a panic of a Rust extension is no Exception
            missing.append({"name": name, "status": "failed", "reason": _one_line(error)})

    def _time(self, contenders: list[Contender]) -> None:
        for contender in contenders:
            for call in contender.calls[1:]:  # every input once: memory, caches, clock rates
                if contender.spent < BUDGET_SECONDS:
                    contender.spent += self.clock.seconds(iter([call]), 1)
            if not self.toy:
                seconds = contender.sample(self.clock)
                contender.count = min(MOST_CALLS, max(1, math.ceil(SAMPLE_SECONDS / seconds)))
            contender.spent = 0.0
        for turn in range(self.rounds):
            # Each round starts with another contender, so that none always follows the same one.
            first = turn % len(contenders)
            for contender in contenders[first:] + contenders[:first]:
                if not contender.done:
                    contender.samples.append(contender.sample(self.clock))

    def _record(
        self, contender: Contender, moved: int, count: float | None, base: float
    ) -> dict[str, Any]:
        low, median, high = np.quantile(contender.samples, [0.25, 0.5, 0.75])
        return {
            "name": contender.name,
            "status": "timed",
            "median_s": float(median),
            "quartiles_s": [float(low), float(high)],
            "samples": len(contender.samples),
            "calls_per_sample": contender.count,
            "gb_per_s": moved / median / 1e9,
            "share_of_copy": moved / median / self.copy_bandwidth,
            **({} if count is None else {"work_per_s": count / median}),
            "ratio": float(median) / base,  # above 1: cvkern's plain call is faster
            **contender.about,
        }


def _load(inputs: Inputs, module: str, device: str) -> Inputs:
    return tuple(load(array, module, device) for array in inputs)


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split()) or "no message"
    return f"{type(error).__name__}: {text[:160]}"
