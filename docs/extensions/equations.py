"""Equations as MathML, which browsers draw without a script from elsewhere."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.util import logging

logger = logging.getLogger(__name__)
# Browsers fit the size of brackets to their contents.
SIZES = re.compile(r"\\[bB]igg?[lrm]?(?![a-zA-Z])")


def _mathml(node: nodes.Element, display: bool) -> str:
    text = SIZES.sub("", node.astext())
    try:
        return str(latex2mathml.tex2mathml(text, as_block=display))
    except (MathError, SyntaxError) as error:
        logger.warning("an equation is not understood: %s in %r", error, text, location=node)
        return f"<code>{nodes.Text(text)}</code>"


def _inline(self: Any, node: nodes.Element) -> None:
    self.body.append(_mathml(node, display=False))
    raise nodes.SkipNode


def _block(self: Any, node: nodes.Element) -> None:
    self.body.append(f'<div class="equation">{_mathml(node, display=True)}</div>')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    """Offer Sphinx the renderer, and choose it."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
