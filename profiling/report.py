"""Turn profiling/results/*.json into tables and a plot: ``python -m profiling.report``.

They go to docs/measured.md and docs/ratios.svg. ``--check`` writes nothing, and exits with 1 if
they are out of date.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
from pathlib import Path
from typing import Any

from .record import ROOT, write_text

BEGIN, END = "<!-- profiling:begin -->", "<!-- profiling:end -->"
PAGE = ROOT / "docs" / "measured.md"
RESULTS = ROOT / "profiling" / "results"
PLOT = "ratios.svg"
FASTER, SLOWER, OTHER = "#2f6db3", "#d97a1f", "#5f6368"
KERNELS = {"warp": "Warp", "taichi": "Taichi"}

Result = dict[str, Any]


def read_results(folder: Path) -> dict[str, list[Result]]:
    """Read the runs, oldest first, as rows of each device: a later run replaces the same row."""
    runs = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))]
    devices: dict[str, dict[tuple[str, str], Result]] = {}
    runs = [run for run in runs if run.get("toy") is False]  # neither toys nor experiments
    for run in sorted(runs, key=lambda run: run["date"]):
        name = run["device"]["name"]
        if run["device"]["kind"] == "cpu":
            name += f", {run['host']['cores']} cores"
        rows = devices.setdefault(f"{name}, {KERNELS[run['backend']]} kernels", {})
        for result in run["results"]:
            rows[result["case"], result["size"]] = result | {
                "commit": run["commit"],
                "date": run["date"][:10],
            }
        for failure in run["failures"]:  # an answer now known to be wrong keeps no old time
            rows.pop((failure["case"], failure["size"]), None)
    return {name: list(rows.values()) for name, rows in sorted(devices.items()) if rows}


def timed(result: Result) -> list[Result]:
    return [one for one in result["contenders"] if one["status"] == "timed"]


def rate(result: Result, one: Result) -> str:
    """Say how much of its work a contender does in a second; nothing where bytes say it all."""
    if "work_per_s" not in one:
        return ""
    value, unit = one["work_per_s"], result["work"]["unit"]
    scale, prefix = (1e9, "G") if value >= 1e8 else (1e6, "M")
    return f"{value / scale:.3g} {prefix}{unit}/s"


def peers(result: Result) -> list[Result]:
    """Give the peers that were timed, the fastest first."""
    others = (one for one in timed(result) if not one["name"].startswith("cvkern"))
    return sorted(others, key=lambda one: one["median_s"])


def ours(result: Result) -> list[Result]:
    """Give cvkern's plain call, and its graph where there is one, the faster first."""
    calls = (one for one in timed(result) if one["name"].startswith("cvkern"))
    return sorted(calls, key=lambda one: one["median_s"])


def section(devices: dict[str, list[Result]], plot: str) -> str:
    """Write the Markdown between the markers."""
    if not devices:
        return "No results yet."
    parts = [
        "Medians in milliseconds. The peers of a row ran in turns with cvkern, in the same "
        "process; cvkern's answer was checked against another library's before it was timed.",
        f"![Time of each peer over the time of cvkern]({plot})",
    ]
    for name, rows in devices.items():
        parts += [f"**{name}**", *table(rows)]
    return "\n\n".join(parts)


def table(rows: list[Result]) -> list[str]:
    """Write the Markdown table of a device, and the notes that belong under it."""
    return [_table(rows), _notes(rows)]


def _table(rows: list[Result]) -> str:
    graphs = any(one["name"] == "cvkern, graph" for row in rows for one in timed(row))
    rates, rated = any("work" in row for row in rows), f"rate{', of the faster' * graphs}"
    head = ["operation", "size", "cvkern", *["as a graph"] * graphs, *[rated] * rates]
    head += ["fastest peer", "cvkern is"]
    lines = [head, ["---", "---", *["---:"] * (len(head) - 2)]]
    for row in rows:
        times = {one["name"]: f"{one['median_s'] * 1e3:.3g}" for one in timed(row)}
        line = [row["title"], row["size"], times["cvkern"]]
        if graphs:
            line.append(times.get("cvkern, graph", ""))
        if rates:
            line.append(rate(row, ours(row)[0]))
        if best := next(iter(peers(row)), None):
            line += [f"{times[best['name']]} ({best['name']})", in_words(best["ratio"])]
        else:
            line += ["none", ""]
        lines.append(line)
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def in_words(ratio: float) -> str:
    """Say a ratio of times so that nobody has to ask which way it goes."""
    return f"{ratio:.2f} x faster" if ratio >= 1 else f"{1 / ratio:.2f} x slower"


def _notes(rows: list[Result]) -> str:
    commits = sorted({f"{row['commit']} ({row['date']})" for row in rows})
    missing = {
        f"{one['name']} ({one['status']})"
        for row in rows
        for one in row["contenders"]
        if one["status"] != "timed"
    }
    said = {
        f"{one['name']} in {row['case']} ({one['note']})"
        for row in rows
        for one in timed(row)
        if "note" in one
    }
    notes = [
        f"Measured at {', '.join(commits)}.",
        *([f"Not quite the same: {', '.join(sorted(said))}."] if said else []),
        *([f"Not timed: {', '.join(sorted(missing))}."] if missing else []),
    ]
    return " ".join(notes)


def draw(devices: dict[str, list[Result]]) -> str:
    """Draw the ratios as an SVG: a bar to the fastest peer, a dot for each of the others."""
    import matplotlib
    from matplotlib.figure import Figure

    compared = {name: [row for row in rows if peers(row)] for name, rows in devices.items()}
    shown = {name: rows for name, rows in compared.items() if rows}
    counts = [len(rows) for rows in shown.values()]
    # A fixed salt and no date: the same results give the same file.
    with matplotlib.rc_context({"svg.hashsalt": "cvkern", "font.size": 9}):
        figure = Figure(figsize=(9, 1.0 + 0.8 * len(counts) + 0.26 * sum(counts)))
        panels = figure.subplots(len(counts), 1, squeeze=False, height_ratios=counts)[:, 0]
        for panel, (name, rows) in zip(panels, shown.items(), strict=True):
            _panel(panel, name, rows)
        panels[-1].set_xlabel("time of the peer / time of cvkern (log scale; right of 1: faster)")
        figure.tight_layout()
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()


def _panel(panel: Any, name: str, rows: list[Result]) -> None:
    from matplotlib.ticker import LogLocator

    for y, row in enumerate(rows):
        for i, peer in enumerate(peers(row)):
            ratio = peer["ratio"]
            if i:
                panel.plot(ratio, y, "o", color=OTHER, markersize=4, markeredgecolor="white")
                continue
            panel.barh(y, ratio - 1, left=1, height=0.6, color=FASTER if ratio >= 1 else SLOWER)
            panel.text(
                1.01,
                y,
                f"{peer['name']}  {ratio:.2f}",
                transform=panel.get_yaxis_transform(),
                va="center",
                fontsize=8,
            )
    panel.set_xscale("log")
    low, high = panel.get_xlim()
    panel.set_xlim(min(low, 0.5) / 1.5, max(high, 2.0) * 1.5)
    panel.set_yticks(range(len(rows)), [f"{row['case']}  {row['size']}" for row in rows])
    panel.set_ylim(len(rows) - 0.4, -0.6)
    panel.axvline(1, color="black", linewidth=0.8)
    panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    panel.xaxis.set_major_formatter("{x:g}")
    panel.xaxis.set_minor_formatter("")
    panel.grid(axis="x", color="#e3e5e8", linewidth=0.6)
    panel.set_axisbelow(True)
    panel.spines[["top", "right", "left"]].set_visible(False)
    panel.tick_params(axis="y", length=0)
    panel.set_title(name, loc="left", fontsize=10)


def main(command: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m profiling.report", description=__doc__)
    parser.add_argument("--page", type=Path, default=PAGE)
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--check", action="store_true", help="only say whether it is up to date")
    args = parser.parse_args(command)

    devices = read_results(args.results)
    plot = args.page.with_name(PLOT)
    try:
        before = args.page.read_text(encoding="utf-8")
        after = replace(before, section(devices, PLOT))
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    if args.check:
        stale = before != after or (bool(devices) and not plot.is_file())
        print(f"{args.page.name} is {'stale: python -m profiling.report' if stale else 'right'}")
        return int(stale)
    if devices:
        write_text(plot, draw(devices))
    write_text(args.page, after)
    return 0


def replace(text: str, new: str) -> str:
    """Put `new` between the markers of `text`."""
    begin, end = text.find(BEGIN), text.find(END)
    if not 0 <= begin < end:
        raise ValueError(f"the page must hold {BEGIN} and, behind it, {END}")
    return f"{text[: begin + len(BEGIN)]}\n{new}\n{text[end:]}"


if __name__ == "__main__":
    raise SystemExit(main())
