"""Warnings of results that are empty because of a setting."""

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
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("cvkern."):
        depth, frame = depth + 1, frame.f_back
    return depth + 1
