"""``python -m profiling``: check and time cases, print the table, write the JSON."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import cvkern

from . import clock, record
from .case import SIZES, TOY
from .cases import CASES
from .report import rate
from .runner import Bench


def main(command: list[str] | None = None) -> int:
    command = sys.argv[1:] if command is None else command
    args = _arguments(command)
    if args.json and not args.json.parent.is_dir():
        return _refuse(f"--json must be in a folder that exists, got {args.json}")
    seed = np.random.SeedSequence().entropy if args.seed is None else args.seed

    console = Console(width=None if sys.stdout.isatty() else 120)
    with cvkern.use(backend=args.backend, device=args.device):
        try:
            timer = clock.clock(args.device)
        except (ImportError, RuntimeError, ValueError) as error:
            return _refuse(f"--device must be one that is here, got {args.device}: {error}")
        bandwidth = clock.copy_bandwidth(timer, 4 << 20 if args.toy else clock.COPY_BYTES)
        bench = Bench(
            args.device, args.backend, timer, np.random.default_rng(seed), bandwidth, args.toy
        )
        console.print(f"copy {bandwidth / 1e9:.0f} GB/s, seed {seed}")
        whole = record.surroundings(args.device, command)
        if args.json and not args.toy and record.is_dirty(whole["commit"]):
            return _refuse(f"--json must record a commit, got {whole['commit']}: commit first")
        whole["device"]["copy_gb_per_s"] = bandwidth / 1e9
        whole |= {"backend": args.backend, "toy": args.toy, "seed": str(seed)}
        results, failures = [], []
        shapes = SIZES | {"toy": TOY}
        for name, size in _runs(args):
            console.print(f"[dim]{name} {size}[/]")
            try:
                results.append({"size": size} | bench.run(CASES[name], shapes[size]))
            except Exception as error:  # one case that fails must not cost the others
                reason = " ".join(f"{type(error).__name__}: {error}".split())
                failures.append({"case": name, "size": size, "reason": reason})
                console.print(reason, style="red", markup=False)
            if args.json:  # after each case: a run that is cut short keeps what it has
                record.write_json(args.json, whole | {"results": results, "failures": failures})
    console.print(table(results))
    for name, reason in sorted(
        {
            (one["name"], one["reason"])
            for result in results
            for one in result["contenders"]
            if one["status"] != "timed"
        }
    ):
        console.print(f"{name}: {reason}", style="dim", markup=False)
    for failure in failures:
        said = f"not timed: {failure['case']} {failure['size']}: {failure['reason']}"
        console.print(said, style="red", markup=False)
    return 1 if failures else 0


def table(results: list[dict[str, Any]]) -> Table:
    """Show every contender of every case, and why one is missing."""
    shown = Table(title="times the time of cvkern's plain call: above 1, cvkern is faster")
    for heading in ("case", "size", "who"):
        shown.add_column(heading, no_wrap=True)
    for heading in ("ms", "IQR", "GB/s", "of copy", "rate", "ratio", "off by"):
        shown.add_column(heading, justify="right", no_wrap=True)
    for result in results:
        for i, one in enumerate(result["contenders"]):
            where = (result["case"], result["size"]) if i == 0 else ("", "")
            if one["status"] != "timed":
                shown.add_row(*where, one["name"], one["status"], style="dim")
                continue
            low, high = one["quartiles_s"]
            style = "yellow" if one["ratio"] < 1 and i else ""
            shown.add_row(
                *where,
                one["name"],
                f"{one['median_s'] * 1e3:.3f}",
                f"{(high - low) * 1e3:.3f}",
                f"{one['gb_per_s']:.1f}",
                f"{one['share_of_copy']:.0%}",
                rate(result, one),
                f"{one['ratio']:.2f}" if i else "",
                f"{one['difference']:.1e}",
                style=style,
            )
        shown.add_section()
    return shown


def _runs(args: argparse.Namespace) -> list[tuple[str, str]]:
    """List each case with each of its sizes, or of those asked for."""
    return [
        (name, size)
        for name in args.case
        for size in (["toy"] if args.toy else args.size or CASES[name].sizes)
    ]


def _refuse(reason: str) -> int:
    print(reason, file=sys.stderr)
    return 2


def _arguments(command: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m profiling", description=__doc__)
    parser.add_argument("--case", nargs="+", choices=CASES, default=list(CASES), metavar="NAME")
    parser.add_argument("--size", nargs="+", choices=SIZES, help="default: those of each case")
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--backend", choices=["warp", "taichi"], default="warp")
    parser.add_argument("--toy", action="store_true", help="tiny images, two rounds: does it run?")
    parser.add_argument("--seed", type=int, help="repeat the inputs of an earlier run")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results")
    return parser.parse_args(command)


if __name__ == "__main__":
    raise SystemExit(main())
