"""Warnings on the line that called cvkern, and when a look at a result costs nothing."""

from __future__ import annotations

import sys
import warnings

from cvkern._arrays import NUMPY
from cvkern._runtime import Runtime
from cvkern._tape import capturing


def may_look(rt: Runtime) -> bool:
    """Tell whether a look at a result costs no wait for a GPU."""
    return rt.device == "cpu" and rt.library is NUMPY and not capturing()


def warn(text: str) -> None:
    """Warn on the line that called cvkern."""
    warnings.warn(text, UserWarning, stacklevel=_depth())


def _depth() -> int:
    """Return the number of frames from :func:`warn` up to the caller of cvkern."""
    depth, frame = 0, sys._getframe(1)
    while frame.f_back is not None and _is_ours(frame.f_globals.get("__name__", "")):
        depth, frame = depth + 1, frame.f_back
    return depth + 1


def _is_ours(module: str) -> bool:
    """Tell whether a frame is cvkern's, or that of a decorator made of a context."""
    return module.startswith("cvkern.") or module == "contextlib"
