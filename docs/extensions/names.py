"""Link public names: ``gaussian`` or ``cvkern.gaussian`` in code type leads to the reference.

Paths in tables may be broken after a slash.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes


def _target(app: Any, docname: str, text: str) -> tuple[str, str] | None:
    """Return (page, anchor) of a name of the library, or None."""
    objects = app.env.domains["py"].objects
    name = re.sub(r"\(\)$", "", text)
    family = docname.rpartition("/")[2]
    tried = [name, f"cvkern.{name}"]
    if family in ("images", "clouds", "radiance", "scale"):
        tried.insert(0, f"cvkern.{family}.{name}")
    for full in tried:
        if full.startswith("cvkern.") and full in objects:
            return objects[full].docname, objects[full].node_id
    return None


BREAK = "\u200b"  # a space without width


def _let_paths_break(doctree: nodes.document) -> None:
    for table in doctree.findall(nodes.table):
        for literal in table.findall(nodes.literal):
            text = literal.astext()
            if re.fullmatch(r"[\w./]+/[\w.]*", text):
                literal.children = [nodes.Text(text.replace("/", "/" + BREAK))]


def _link(app: Any, doctree: nodes.document, docname: str) -> None:
    if docname.startswith("coming_from/"):
        for table in doctree.findall(nodes.table):
            table["classes"].append("calls")  # two columns of code: the style sheet has room for it
    else:
        _let_paths_break(doctree)
    for literal in list(doctree.findall(nodes.literal)):
        if isinstance(literal.parent, nodes.reference):
            continue
        found = _target(app, docname, literal.astext())
        if found is None or (found[0] == docname and not literal.astext().endswith("()")):
            continue
        uri = app.builder.get_relative_uri(docname, found[0]) + "#" + found[1]
        reference = nodes.reference("", "", refuri=uri, internal=True)
        literal.replace_self(reference)
        reference += literal


def setup(app: Any) -> dict[str, bool]:
    """Link once all pages are read, so that every name is known."""
    app.connect("doctree-resolved", _link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
