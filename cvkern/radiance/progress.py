"""The progress of a training on a terminal or in a log, and its end by Ctrl-C."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

Say = Callable[[float, str], None]  # takes the share that is done, and the next work

LINE = 10.0  # seconds between lines of progress in a log


@contextlib.contextmanager
def stoppable() -> Iterator[threading.Event]:
    """Turn the first Ctrl-C into an event, in the main thread; the second interrupts as usual."""
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return
    before = signal.getsignal(signal.SIGINT)

    def note(number: int, stack: Any) -> None:
        event.set()
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, note)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)


def _lines() -> Say:
    """Return a function that prints a line every LINE seconds, for logs."""
    last = time.monotonic()

    def say(share: float, text: str) -> None:
        nonlocal last
        if time.monotonic() - last >= LINE:
            last = time.monotonic()
            print(f"{share:.0%}  {text}", file=sys.stderr, flush=True)

    return say


@contextlib.contextmanager
def shown(wanted: bool) -> Iterator[Say]:
    """Yield a function that shows the progress on a terminal, or prints lines without one."""
    if not wanted:
        yield lambda share, text: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield _lines()
        return
    columns = (BarColumn(32), TextColumn("{task.description}"), TimeRemainingColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("Compiling", total=1.0)
        yield lambda share, text: bar.update(task, completed=share, description=text)
