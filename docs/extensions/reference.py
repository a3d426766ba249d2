"""Write the pages of the reference: every public name by family, as the library lists them."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path
from typing import Any

import cvkern

FOLDER = "_generated/reference"


def families() -> dict[str, tuple[str, list[str]]]:
    """Return the module and the full public names of each family, in the order of the pages."""
    found = {
        module.lstrip("_"): (f"cvkern.{module}", [f"cvkern.{name}" for name in names])
        for module, names in cvkern._NAMES.items()
        if module[0] != "_"
    }
    for name in cvkern._NAMESPACES:
        module = importlib.import_module(f"cvkern.{name}")
        found[name] = (module.__name__, [f"{module.__name__}.{one}" for one in module.__all__])
    private = [n for module, names in cvkern._NAMES.items() if module[0] == "_" for n in names]
    return {**found, "runtime": ("cvkern", [f"cvkern.{name}" for name in sorted(private)])}


def page(family: str, module: str, names: list[str]) -> str:
    """Return one page: a table of the names, then each with its docstring and its examples."""
    title = f"cvkern.{family}" if family != "runtime" else "Device and kernel set"
    about = (
        importlib.import_module(module).__doc__ or ""
        if family != "runtime"
        else ("Where calls compute, and calls recorded to be repeated.")
    )
    shown = sorted(names, key=lambda name: (name.rpartition(".")[2][0].isupper(), name))
    lines = [title, "=" * len(title), "", inspect.cleandoc(about).split("\n\n")[0], ""]
    lines += [".. autosummary::", "   :nosignatures:", ""]
    lines += [f"   ~{name}" for name in shown] + [""]
    for name in shown:
        lines += _entry(name)
    return "\n".join(lines)


def _entry(name: str) -> list[str]:
    module, _, last = name.rpartition(".")
    found = getattr(importlib.import_module(module), last)
    heading = ["", last, "-" * len(last), ""]
    if not callable(found):
        return [*heading, f".. autodata:: {name}", "   :no-value:", ""]
    if inspect.isclass(found):
        return [*heading, f".. autoclass:: {name}", "   :members:", ""]
    return [*heading, f".. autofunction:: {name}", "", f".. minigallery:: {name}", ""]


def _write(app: Any) -> None:
    folder = Path(app.srcdir, FOLDER)
    folder.mkdir(parents=True, exist_ok=True)
    pages = {name: page(name, *rest) for name, rest in families().items()}
    listed = "\n".join(f"   {name}" for name in pages)
    pages["index"] = (
        "Reference\n=========\n\nEvery public name, by its family.\n\n"
        f".. toctree::\n   :maxdepth: 2\n\n{listed}\n"
    )
    for name, text in pages.items():
        file = folder / f"{name}.rst"
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Write the pages before Sphinx looks for sources."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
