"""Tests whether a kernel set gives correct results on a device of this machine.

``python -m cvkern.app.doctor SET DEVICE`` prints a finding as JSON. Each set and device is examined
in a separate process, because a broken driver may end the process.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

import cvkern
from cvkern.kernels import _cache

_COMPILED = (".tic", ".tcb", ".ptx", ".cubin")


@dataclass
class Finding:
    """The result of the tests of one kernel set on one device."""

    backend: str
    device: str
    absent: str = ""
    """The reason why the kernel set or the device cannot be used at all, or empty."""
    wrong: dict[str, str] = field(default_factory=dict)
    """For each tested function, the fault of its result, or an empty string."""
    seconds: float = 0.0
    """Time of the first calls: starting the set, and compiling or loading the kernels."""
    cache: str = ""
    """Folder of the compiled kernels."""
    cache_fault: str = ""
    """The fault of that folder or its files, or empty."""
    devices: list[str] = field(default_factory=list)
    """Devices that the kernel set finds."""

    @property
    def healthy(self) -> bool:
        """Whether all tested functions gave correct results."""
        return not self.absent and bool(self.wrong) and not any(self.wrong.values())


def examine(backend: str, device: str, timeout: float = 600.0) -> Finding:
    """Examine a kernel set on a device, in a new process."""
    command = [sys.executable, "-m", "cvkern.app.doctor", backend, device]
    finding = Finding(backend, device)
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout)
    except subprocess.TimeoutExpired:
        finding.wrong["process"] = f"no answer within {timeout:g} s"
        return finding
    try:
        return Finding(**json.loads(done.stdout.splitlines()[-1]))
    except (IndexError, ValueError, TypeError):  # it ended without a complete answer
        said = done.stderr.strip().splitlines()
        finding.wrong["process"] = said[-1] if said else f"ended with code {done.returncode}"
        return finding


def folder_size(folder: str) -> int:
    """Return the bytes of all files below `folder`; 0 if it does not exist."""
    return sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file())


def cache_fault(kernel_set: str, folder: str) -> str:
    """Return the fault of a folder of compiled kernels, or an empty string."""
    if reason := _cache.refusal(folder):
        variable = _cache.VARIABLES[kernel_set]
        return f"nothing can be written in {folder} ({reason}): set {variable} to another folder"
    broken = [file for file in Path(folder).rglob("*") if file.is_file() and not _whole(file)]
    if broken:
        others = f" and {len(broken) - 1} more" if broken[1:] else ""
        return f"{broken[0]}{others} cannot be read; kernels there are compiled again when used"
    return ""


def _whole(file: Path) -> bool:
    """Tell whether a file of a kernel cache is complete, judged by its format."""
    try:
        if file.suffix == ".meta":
            json.loads(file.read_bytes())
        elif file.suffix == ".o":
            data = file.read_bytes()
            if data[:6] == b"\x7fELF\x02\x01":  # 64 bits, little-endian
                table, size, count = (
                    int.from_bytes(data[i:j], "little") for i, j in ((40, 48), (58, 60), (60, 62))
                )
                return table + size * count <= len(data)
            return data[:4] not in (b"", b"\x7fELF")
        return file.stat().st_size > 0 or file.suffix not in _COMPILED
    except (OSError, ValueError):
        return not file.exists()  # another process may have deleted it


def gaussian() -> str:
    """Compare with SciPy; return the fault, or an empty string."""
    from scipy import ndimage

    image = np.random.default_rng(0).random((37, 53), dtype=np.float32)
    error = float(np.abs(cvkern.gaussian(image, 1.5) - ndimage.gaussian_filter(image, 1.5)).max())
    return "" if error <= 1e-5 else f"differs from SciPy by {error:.2g}"


def canny() -> str:
    """Find a step whose height decreases from row to row, but not a separate faint step.

    The first step is strong in its upper rows, and weak but connected down to row 20. The faint
    step is weak and not connected to a strong one.
    """
    height = 200 - 8 * np.arange(24, dtype=np.uint8)[:, None]
    image = np.where(np.arange(44) >= 20, height, np.uint8(0))
    image[:, 32:] += 40
    edges = cvkern.canny(image, 0, 200, 600, suppression="sectors", norm="l1", mode="nearest")
    expected = np.zeros(image.shape, bool)
    expected[:21, 20] = True
    wrong = int((edges != expected).sum())
    return "" if wrong == 0 else f"{wrong} of {edges.size} pixels are wrong"


CHECKS: dict[str, Callable[[], str]] = {"gaussian": gaussian, "canny": canny}


def probe(backend: str, device: str) -> Finding:
    """Examine a kernel set on a device, in this process."""
    finding = Finding(backend, device)
    try:
        use = cvkern.use(backend=backend, device=device)
    except (ValueError, ImportError) as error:
        finding.absent = str(error)
        return finding
    start = time.perf_counter()
    with use, warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", RuntimeWarning)
        for name, check in CHECKS.items():
            try:
                finding.wrong[name] = check()
            except Exception as error:
                finding.wrong[name] = f"{type(error).__name__}: {error}"
    finding.seconds = time.perf_counter() - start
    if backend == "warp":
        import warp

        finding.cache = str(warp.config.kernel_cache_dir or "")
        finding.devices = [f"{d.alias}: {d.name}" for d in warp.get_devices()]
    else:
        from taichi.lang import impl

        folder = os.environ.get(_cache.VARIABLES[backend])
        finding.cache = folder or impl.default_cfg().offline_cache_file_path
    unkept = [str(w.message) for w in said if "kernels cannot be kept" in str(w.message)]
    finding.cache_fault = unkept[0] if unkept else cache_fault(backend, finding.cache)
    return finding


if __name__ == "__main__":
    print(json.dumps(asdict(probe(*sys.argv[1:]))))
