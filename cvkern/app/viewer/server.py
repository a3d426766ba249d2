"""The server of a page, and pictures that fill its view."""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

HOST = "127.0.0.1"  # this machine only, unless told otherwise
PORT = 8080  # or the next one that is free


class Page:
    """A page that serves its clients from one thread: that of the kernels."""

    def __init__(self, host: str = HOST, port: int = PORT) -> None:
        try:
            viser: Any = import_module("viser")
        except ImportError:
            raise ImportError("the viewer needs viser: pip install viser") from None
        with contextlib.redirect_stdout(io.StringIO()):  # it draws a box
            self.server = viser.ViserServer(host=host, port=port, label="cvkern", verbose=False)
        self.server.gui.main_panel.dock_right()
        self.asked = threading.Event()

    @property
    def address(self) -> str:
        """Where a browser finds the page."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def ask(self, *_: Any) -> None:
        """Note that something changed; callbacks of controls and cameras call this."""
        self.asked.set()

    def wait(self, serve: Callable[[], bool]) -> None:
        """Serve until Ctrl-C; `serve` returns whether there is more to do."""
        try:
            while True:
                more = serve()
                self.asked.wait(0 if more else None)
                self.asked.clear()
        except KeyboardInterrupt:
            pass
        finally:
            self.close()

    def close(self) -> None:
        """End the page."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


def fitted(image: np.ndarray, aspect: float) -> np.ndarray:
    """Return an image between black bars, in the aspect (width / height) of a window."""
    high, wide = image.shape[:2]
    height, width, top, left = framed(high, wide, aspect)
    around = ((top, height - high - top), (left, width - wide - left), (0, 0))
    return np.pad(image, around)


def framed(high: int, wide: int, aspect: float) -> tuple[int, int, int, int]:
    """Return the size of an image with its bars, and the place of its first pixel there."""
    height, width = max(high, round(wide / aspect)), max(wide, round(high * aspect))
    return height, width, (height - high) // 2, (width - wide) // 2
