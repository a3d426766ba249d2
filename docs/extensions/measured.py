"""The directive ``measured FAMILY``: the rows of profiling/results for the cases of a family."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective


def rows(family: str) -> str:
    """Return one Markdown table per device, with the notes of its results."""
    from profiling import cases, report

    package = import_module(f"{cases.__name__}.{family}")
    modules = [
        import_module(f"{package.__name__}.{one.name}")
        for one in pkgutil.iter_modules(package.__path__)
    ]
    names = {case.name for module in modules for case in module.CASES}
    parts = []
    for device, results in report.read_results(report.RESULTS).items():
        chosen = [result for result in results if result["case"] in names]
        if chosen:
            parts += [f"**{device}**", *report.table(chosen)]
    if not parts:
        raise ValueError(f"profiling/results has nothing on {family}")
    return "\n\n".join(parts)


class Measured(SphinxDirective):
    """Put the tables of a family on its page."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the tables."""
        try:
            text = rows(self.arguments[0])
        except (ImportError, ValueError) as error:
            raise self.error(str(error)) from error
        container = nodes.Element()
        self.state.nested_parse(StringList(text.splitlines(), "profiling/results"), 0, container)
        return container.children


def setup(app: Any) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("measured", Measured)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
