"""Call functions at random, in processes that may crash or hang, and report what should not be.

``python -m tests.fuzz --calls N --seed S``; ``--first I`` goes on from there, ``--only I`` makes
one call.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CHUNK = 400  # calls in one process
PATIENCE = 120.0  # seconds for one call, compilation included


def main() -> int:
    """Run the calls, and return how many of them were at fault, at most 1."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--calls", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", type=int)
    given = parser.parse_args()
    if given.only is not None:
        given.first, given.calls = given.only, 1
    last, at, faults, made = given.first + given.calls, given.first, 0, 0
    while at < last:
        stop = min(at + CHUNK, last)
        at, found, done = _chunk(given.seed, at, stop)
        made += done
        for fault in found:
            faults += 1
            print(json.dumps(fault), flush=True)
    print(f"{made} calls from {given.first} on with seed {given.seed}, {faults} at fault")
    return min(faults, 1)


def _chunk(seed: int, first: int, stop: int) -> tuple[int, list[dict], int]:
    """Make calls in one process; return where to go on, and what was wrong."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        log.touch()
        words = [
            sys.executable,
            "-m",
            "tests.fuzz.worker",
            str(seed),
            str(first),
            str(stop),
            str(log),
        ]
        with (Path(folder) / "said").open("wb") as said:
            process = subprocess.Popen(words, stdout=said, stderr=said)
            at, since, size = first, time.monotonic(), -1
            while process.poll() is None:
                time.sleep(0.05)
                grown = os.stat(log).st_size
                if grown != size:
                    size, since = grown, time.monotonic()
                if time.monotonic() - since > PATIENCE:
                    process.kill()
                    process.wait()
                    break
        lines = [json.loads(line) for line in log.read_text().splitlines() if line.endswith("}")]
        tail = (Path(folder) / "said").read_text(errors="replace")[-2000:]
    begun = [line["begin"] for line in lines if "begin" in line]
    at = begun[-1] if begun else first
    faults = [line for line in lines if "fault" in line]
    if any("end" in line for line in lines):
        return stop, faults, stop - first
    code = process.returncode
    kind = "no answer in time" if code == -9 else f"the process ended with {code}: {tail}"
    faults.append({"call": at, "seed": seed, "fault": kind})
    return at + 1, faults, at + 1 - first


if __name__ == "__main__":
    sys.exit(main())
