"""Call functions at random, in processes that may crash or hang, and report their faults.

``python -m tests.fuzz --calls N --seed S`` makes the calls 0 to N - 1 of that seed; ``--first I``
goes on from there, ``--only I`` makes one call. ``--workers W`` makes them in so many processes,
each of which computes with ``--threads T``, and ``--minutes M`` ends after that time, whatever
`--calls` says. ``--device cuda`` compares the sets there with Warp on the CPU. ``--family F`` calls
those of a module of `tests.fuzz.families`.
"""

from __future__ import annotations

import argparse
import collections
import os
import re
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

from tests.fuzz.processes import Chunk, Process

FAMILIES = sorted(path.stem for path in Path(__file__).parent.glob("families/[a-z]*.py"))
CHUNK = 20  # calls that a process is given at a time, about
LEAD = 250  # chunks that a part may be ahead of the last
EXAMPLES = 3  # faults of one kind that are printed


class Work:
    """The calls yet to be made, and what was found; shared by the threads of all processes.

    The functions are in as many parts as there are processes. Each process stays with a part,
    since it has compiled the kernels of that part, until another part is far behind.
    """

    def __init__(self, given: argparse.Namespace):
        self.given = given
        self.last = given.first + given.calls
        self.next = [given.first] * given.workers  # the next call of each part
        self.end = time.monotonic() + 60 * given.minutes if given.minutes else float("inf")
        self.made = self.peak = 0
        self.kinds: collections.Counter[str] = collections.Counter()
        self.lock = threading.Lock()

    def take(self, part: int) -> Chunk | None:
        """Return the calls that the process of a part makes next."""
        with self.lock:
            behind = min(range(len(self.next)), key=self.next.__getitem__)
            if self.next[behind] >= self.last or time.monotonic() > self.end:
                return None
            size = CHUNK * len(self.next)
            if self.next[part] - self.next[behind] > LEAD * size or self.next[part] >= self.last:
                part = behind
            first, stop = self.next[part], min(self.next[part] + size, self.last)
            self.next[part] = stop
            return Chunk(first, stop, part, len(self.next))

    def report(self, fault: dict[str, Any]) -> None:
        """Print a fault and the command that repeats it, unless it was seen often."""
        where = re.sub(r"'[^']*'|\d+|got .*", "", fault["fault"].replace("\n", " "))[:90]
        kind = f"{fault.get('name', 'the process')}: {where}"
        device = "" if self.given.device == "cpu" else f" --device {self.given.device}"
        device += f" --family {self.given.family}" if self.given.family else ""
        with self.lock:
            self.kinds[kind] += 1
            if self.kinds[kind] <= EXAMPLES:
                print(f"{fault.get('name', '')}({fault.get('arguments', '')})\n  {fault['fault']}")
                once = f"--seed {self.given.seed} --only {fault['call']}{device}"
                print(f"  python -m tests.fuzz {once}", flush=True)

    def done(self, calls: int, peak: int) -> None:
        """Count calls."""
        with self.lock:
            self.made += calls
            self.peak = max(self.peak, peak)


def serve(work: Work, part: int) -> None:
    """Let one process after another make calls of a part, until there are none left."""
    given = work.given
    process = Process(given.seed, given.device, given.threads, given.family)
    try:
        while (chunk := work.take(part)) is not None:
            while chunk.first < chunk.stop:
                first, made, peak = process.make(chunk, work.report)
                work.done(made, peak)
                chunk = chunk._replace(first=first)
    finally:
        process.close()


def main() -> int:
    """Run the calls, and return 1 where one was at fault."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--calls", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", type=int)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--minutes", type=float)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--family", choices=FAMILIES, default="")
    given = parser.parse_args()
    if given.only is not None:
        given.first, given.calls = given.only, 1
    if given.threads is None:
        given.threads = max(1, (os.cpu_count() or 1) // given.workers)
    if given.calls is None:
        given.calls = 2**31 if given.minutes else 400
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # it ends as Ctrl-C ends it
    work, since = Work(given), time.monotonic()
    runners = [threading.Thread(target=serve, args=(work, n)) for n in range(given.workers)]
    for runner in runners:
        runner.start()
    try:
        for runner in runners:
            runner.join()
    except KeyboardInterrupt:  # the calls that processes were given are made, and then it ends
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        work.end = 0.0
        for runner in runners:
            runner.join()
    took = time.monotonic() - since
    for kind, count in work.kinds.most_common():
        print(f"{count:6} x {kind}")
    rate = f"{work.made / took:.0f} a second, at most {work.peak >> 10} MiB a process"
    if min(work.next) < work.last:
        rate += f"; --first {min(work.next)} goes on"
    print(rate)
    print(
        f"{work.made} calls from {given.first} on with seed {given.seed}, "
        f"{sum(work.kinds.values())} at fault"
    )
    return min(sum(work.kinds.values()), 1)


if __name__ == "__main__":
    sys.exit(main())
