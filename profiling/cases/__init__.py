"""The cases of every module in the folders here, by name."""

import importlib
import pkgutil

from ..case import Case

CASES: dict[str, Case] = {}
for _module in pkgutil.walk_packages(__path__, f"{__name__}."):
    CASES |= {
        case.name: case for case in getattr(importlib.import_module(_module.name), "CASES", ())
    }
