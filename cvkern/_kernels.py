"""Access to the kernels of a set by folder and file name: ``kernels.stereo.winners.pick``.

`_kernels.pyi` describes the same tree for type checkers.
"""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any


class Folder:
    """A folder of kernel modules, each imported when it is first used."""

    def __init__(self, package: str):
        self._package = package

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            module: ModuleType | Folder = importlib.import_module(f"{self._package}.{name}")
        except ModuleNotFoundError as absent:
            if absent.name != f"{self._package}.{name}":
                raise
            raise AttributeError(f"{self._package} has no module {name!r}") from None
        if hasattr(module, "__path__"):
            module = Folder(f"{self._package}.{name}")
        setattr(self, name, module)
        return module
