"""Calls that compile the kernels of edges."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from cvkern.app.warmup import pictures
from cvkern.edges import canny, subpixel_edges


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function, and for every dtype with its own kernels."""
    byte, real, color = pictures()
    for norm in ("l1", "l2"):
        yield "canny", partial(canny, byte, 0, 5, 10, suppression="sectors", norm=norm)
        yield "canny", partial(canny, byte, 1, 5, 10, norm=norm)
        yield "canny", partial(canny, real, 1, 0.4, 0.9, real > 0, True, norm=norm)
    yield "canny", partial(canny, color, 0, 5, 10, suppression="sectors")
    yield "subpixel_edges", partial(subpixel_edges, real, 1, 0.4, 0.9, use_quantiles=True)
