"""Captured calls."""

from __future__ import annotations

from typing import Any

import cvkern
from tests.fuzz.arguments import IMAGE, Call, number


def repeated(image: Any, sigma: Any) -> Any:
    """Capture a chain of calls and repeat it."""
    return cvkern.capture(
        lambda x: cvkern.gradient(cvkern.gaussian(x, sigma), sigma=sigma), image
    )()


CALLS: dict[str, Call] = {"capture": Call(repeated, {**IMAGE, "sigma": number(0, 4)}, {})}
