"""A process that makes calls, and is replaced when it dies or no longer answers."""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import tempfile
from collections.abc import Callable
from typing import Any, NamedTuple

PATIENCE = 600.0  # seconds for one call, compilation included, on a machine that others use too
# Matrices are small here: more threads of BLAS only wait for each other.
POOLS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
MEMORY = "/dev/shm"  # a folder in memory, for the small files that calls write
WORKER = ["-m", "tests.fuzz.worker"]


class Chunk(NamedTuple):
    """Those calls from one number to another that belong to one of so many parts."""

    first: int
    stop: int
    part: int = 0
    parts: int = 1


class Process:
    """A worker of the fuzzer, started when it is first needed."""

    def __init__(self, seed: int, device: str, threads: int, family: str = ""):
        self._words, self._threads = [str(seed), device, family], threads
        self._process: subprocess.Popen[str] | None = None

    def _start(self) -> subprocess.Popen[str]:
        self._said = tempfile.TemporaryFile("w+", errors="replace")  # noqa: SIM115
        reads, writes = os.pipe()
        folder = {"TMPDIR": MEMORY} if os.access(MEMORY, os.W_OK) else {}
        process = subprocess.Popen(
            [sys.executable, *WORKER, *self._words, str(writes)],
            stdin=subprocess.PIPE,
            stdout=self._said,
            stderr=self._said,
            pass_fds=[writes],
            start_new_session=True,  # Ctrl-C is for the command, which lets calls end
            text=True,
            env={**os.environ, **POOLS, **folder, "CVKERN_NUM_THREADS": str(self._threads)},
        )
        os.close(writes)
        self._log, self._rest = reads, b""
        return process

    def make(self, chunk: Chunk, report: Callable[[dict[str, Any]], None]) -> tuple[int, int, int]:
        """Make calls; return the number of the next, how many, and the most memory held, in KiB."""
        if self._process is None:
            self._process = self._start()
        process, begun, made = self._process, chunk.first, 0
        with contextlib.suppress(BrokenPipeError):
            print(*chunk, file=process.stdin, flush=True)
        while (lines := self._lines()) is not None:
            for line in lines:
                if "begin" in line:
                    begun, made = line["begin"], made + 1
                elif "end" in line:
                    return chunk.stop, made, line["peak"]
                else:
                    report(line)
        late = process.poll() is None and not self._ended
        if late:
            process.kill()
        self.close()
        code = process.returncode
        end = f"the process ended with {code} after calls from {chunk.first} on: {self.said}"
        report({"call": begun, "fault": "no answer in time" if late else end})
        return begun + 1, made, 0

    def _lines(self) -> list[dict[str, Any]] | None:
        """Wait for whole lines; None at the end, or when there are none for too long."""
        self._ended = False
        if not select.select([self._log], [], [], PATIENCE)[0]:
            return None
        got = os.read(self._log, 1 << 16)
        self._ended = not got
        *whole, self._rest = (self._rest + got).split(b"\n")
        return [json.loads(line) for line in whole] if got else None

    def close(self) -> None:
        """End the process."""
        if self._process is None:
            return
        process, self._process = self._process, None
        os.close(self._log)
        with contextlib.suppress(BrokenPipeError):
            if process.stdin is not None:
                process.stdin.close()
        try:
            process.wait(60)  # compiled kernels are written to the cache at the end
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._said.seek(0)
        self.said = self._said.read()[-2000:]
        self._said.close()
