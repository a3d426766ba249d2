"""How each public function is called: a maker for each of its parameters, family by family."""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any

from tests.fuzz.arguments import NONSENSE, Call, Draw

CALLS: dict[str, Call] = {}
for _module in sorted(info.name for info in pkgutil.iter_modules(__path__)):
    CALLS |= importlib.import_module(f"{__name__}.{_module}").CALLS
EVERY = list(CALLS)
# What computes nothing of its own, or is a chain of functions that are called.
NOT_CALLED = {"use", "capture", "devices", "release_memory", "reconstruct_pair"}


def draw_call(draw: Draw) -> tuple[str, dict[str, Any]]:
    """Return the name of a call and its arguments, one of which may be nonsense."""
    name = draw.pick(EVERY)
    call = CALLS[name]
    chosen = {key: make(draw) for key, make in call.needed.items()}
    chosen |= {key: make(draw) for key, make in call.options.items() if draw.odd(0.35)}
    if draw.odd(0.2):
        chosen[draw.pick([*call.needed, *call.options])] = draw.pick(NONSENSE)
    return name, chosen
