"""The page of the tour: the parts of a chapter, and their rendering as one HTML file."""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from cvkern.app.tour.clock import Clock

__all__ = ["Chapter", "Figure", "Panel", "Timing", "render"]


@dataclass(frozen=True)
class Panel:
    """One picture. `file` is its name without suffix; `label` describes it in words.

    An image of shape (F, H, W, 3) is a film. Every file is a WebP.

    `ink` marks black lines on white, which are inverted if the page is dark;
    `pixelated` keeps enlarged pixels square; `small` marks a legend.
    """

    file: str
    image: np.ndarray
    label: str
    ink: bool = False
    pixelated: bool = False
    small: bool = False


@dataclass(frozen=True)
class Timing:
    """Median duration of warm calls of one function on one image, in milliseconds."""

    function: str
    options: str
    shape: tuple[int, ...]
    dtype: str
    milliseconds: float
    runs: int


@dataclass(frozen=True)
class Figure:
    """Pictures side by side, a caption, and the call that made them."""

    title: str
    caption: str
    call: str
    panels: tuple[Panel, ...]
    timings: tuple[Timing, ...] = ()


@dataclass(frozen=True)
class Chapter:
    """One family. `figures` are functions, so that the tour can show its progress."""

    name: str
    title: str
    lead: str
    figures: tuple[Callable[[Clock], Figure], ...]


def render(chapters: Iterable[tuple[Chapter, list[Figure]]], facts: dict[str, str]) -> str:
    """Return the page: HTML that loads no files but those of the panels beside it.

    Parameters
    ----------
    chapters : iterable of (Chapter, list of Figure)
        In order.
    facts : dict
        Versions and devices that the pictures were made with, by name.
    """
    chapters = list(chapters)
    body, timings = [], []
    for order, (chapter, figures) in enumerate(chapters, 1):
        body.append(
            f'<section id="{_text(chapter.name)}"><header class="chapter">'
            f'<p class="order">{order}</p><h2>{_text(chapter.title)}</h2>'
            f'<p class="lead">{_prose(chapter.lead)}</p></header>'
        )
        for place, figure in enumerate(figures, 1):
            body.append(_figure(f"{order}.{place}", figure))
            timings.extend(figure.timings)
        body.append("</section>")
    links = "".join(
        f'<a href="#{_text(chapter.name)}">{_text(chapter.title)}</a>' for chapter, _ in chapters
    )
    shown = "".join(f"<div><dt>{_text(k)}</dt><dd>{_text(v)}</dd></div>" for k, v in facts.items())
    return (
        TEMPLATE.replace("{{style}}", STYLE)
        .replace("{{links}}", links + '<a href="#timings">Timings</a>')
        .replace("{{facts}}", shown)
        .replace("{{body}}", "\n".join(body))
        .replace("{{timings}}", _table(timings))
    )


def _figure(number: str, figure: Figure) -> str:
    pictures = [_picture(panel) for panel in figure.panels if not panel.small]
    legends = "".join(_picture(panel) for panel in figure.panels if panel.small)
    clocks = "".join(
        f"<li><span>{_milliseconds(t.milliseconds)} ms</span>"
        f"<span>{_text(f'{t.function}({t.options})')}</span></li>"
        for t in figure.timings
    )
    return (
        f'<figure><div class="panels n{len(pictures)}">{"".join(pictures)}</div>'
        f'<figcaption><div class="what"><h3><span>{number}</span>{_text(figure.title)}</h3>'
        f"<p>{_prose(figure.caption)}</p>{legends}</div>"
        f'<div class="how"><pre><code>{_text(figure.call)}</code></pre>'
        f"<ul>{clocks}</ul></div></figcaption></figure>"
    )


def _picture(panel: Panel) -> str:
    height, width = panel.image.shape[:2] if panel.image.ndim < 4 else panel.image.shape[1:3]
    kinds = [k for k in ("ink", "pixelated", "small") if getattr(panel, k)]
    return (
        f'<div class="panel {" ".join(kinds)}"><img alt="{_text(panel.label)}" width="{width}" '
        f'height="{height}" loading="lazy" decoding="async" src="{_text(panel.file)}.webp">'
        f"<p>{_prose(panel.label)}</p></div>"
    )


def _table(timings: list[Timing]) -> str:
    """Return all timings as a table; a narrow screen shows each as a few short lines."""
    head = ("Function", "Milliseconds", "Megapixels a second", "Image", "Options")
    rows = (
        (
            f"<code>{_text(t.function)}</code>",
            _milliseconds(t.milliseconds),
            _rate(t.shape[0] * t.shape[1] / t.milliseconds / 1e3),
            f"{' &times; '.join(map(str, t.shape))} {_text(t.dtype)}",
            _text(t.options),
        )
        for t in timings
    )
    body = "".join(f"<tr><td>{'</td><td>'.join(row)}</td></tr>" for row in rows)
    return (
        f"<table><thead><tr><th>{'</th><th>'.join(head)}</th></tr></thead>"
        f"<tbody>{body}</tbody></table>"
    )


def _milliseconds(value: float) -> str:
    return f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:.0f}"


def _rate(value: float) -> str:
    return f"{value:.2g}" if value < 1 else f"{value:.1f}" if value < 10 else f"{value:,.0f}"


def _text(text: str) -> str:
    return html.escape(text)


def _prose(text: str) -> str:
    """Escape `text`; text between backticks becomes code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(text))


TEMPLATE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>A tour of cvkern</title>
<style>{{style}}</style>
</head>
<body>
<nav aria-label="Chapters"><a class="mark" href="#top">cvkern</a><div>{{links}}</div></nav>
<main id="top">
<header class="title">
<h1>A tour of cvkern</h1>
<p class="lead">Every result on this page was computed on this machine, by the call shown below
it, from photographs that come with scikit-image.</p>
<dl>{{facts}}</dl>
</header>
{{body}}
<section id="timings">
<header class="chapter"><h2>Timings</h2>
<p class="lead">Medians of warm calls that take and return NumPy arrays. Compiling the kernels is
not counted, because it happens only once on a machine.</p></header>
{{timings}}
</section>
</main>
</body>
</html>
"""

STYLE = """
:root {
  color-scheme: light dark;
  --paper: #fbfaf8; --raised: #f2f0ec; --ink: #1b1a18; --soft: #6a6761; --line: #e2dfd9;
  --accent: #a8431f;
  --sans: Inter, ui-sans-serif, system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue",
    Arial, sans-serif;
  --mono: ui-monospace, "SF Mono", SFMono-Regular, Menlo, Consolas, "Liberation Mono", monospace;
  --gap: clamp(10px, 1.4vw, 18px);
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #141312; --raised: #1e1d1b; --ink: #eceae5; --soft: #9b978f; --line: #2d2b28;
    --accent: #f0915f;
  }
}
* { box-sizing: border-box; margin: 0; }
html { scroll-behavior: smooth; scroll-padding-top: 72px; -webkit-text-size-adjust: 100%; }
body { background: var(--paper); color: var(--ink); font: 400 16px/1.6 var(--sans);
  -webkit-font-smoothing: antialiased; text-rendering: optimizeLegibility; }
nav, main { width: min(1120px, 100% - clamp(40px, 8vw, 96px)); margin-inline: auto; }
nav { display: flex; justify-content: space-between; align-items: baseline; gap: 24px;
  padding: 26px 0; font-size: 14px; }
nav div { display: flex; flex-wrap: wrap; gap: 4px 24px; }
a { color: var(--soft); text-decoration: none; }
a:hover, a:focus-visible { color: var(--accent); }
.mark { color: var(--ink); font-weight: 650; letter-spacing: -0.01em; }
.title { padding: clamp(56px, 9vw, 120px) 0 clamp(40px, 6vw, 72px); }
h1 { font-size: clamp(40px, 7vw, 76px); font-weight: 680; letter-spacing: -0.035em;
  line-height: 1.02; text-wrap: balance; }
.lead { color: var(--soft); font-size: clamp(17px, 1.7vw, 20px); line-height: 1.5;
  max-width: 38em; text-wrap: pretty; }
.title .lead { margin-top: 24px; }
dl { display: flex; flex-wrap: wrap; gap: 18px 48px; margin-top: clamp(32px, 4vw, 48px);
  padding-top: 20px; border-top: 1px solid var(--line); font-size: 14px; }
dt { color: var(--soft); }
dd { font-weight: 550; font-variant-numeric: tabular-nums; }
section { padding-bottom: clamp(56px, 8vw, 104px); }
.chapter { padding: clamp(24px, 3vw, 36px) 0 clamp(28px, 4vw, 44px);
  border-top: 1px solid var(--line); }
.order { color: var(--accent); font-weight: 600; font-variant-numeric: tabular-nums; }
h2 { font-size: clamp(28px, 3.6vw, 42px); font-weight: 650; letter-spacing: -0.025em;
  line-height: 1.1; margin-bottom: 14px; }
figure + figure { margin-top: clamp(64px, 9vw, 112px); }
.panels { display: grid; gap: calc(1.5 * var(--gap)) var(--gap);
  grid-template-columns: repeat(2, minmax(0, 1fr)); }
.panels.n1 { grid-template-columns: minmax(0, 1fr); }
.panels.n3 { grid-template-columns: repeat(3, minmax(0, 1fr)); }
.panel img { display: block; width: 100%; height: auto; border-radius: 3px;
  background: var(--raised); }
.panel p { color: var(--soft); font-size: 13.5px; line-height: 1.45; margin-top: 8px; }
.pixelated img { image-rendering: pixelated; }
.small { display: flex; align-items: center; gap: 16px; margin-top: 20px; }
.small img { width: 76px; flex: none; background: none; }
.small p { margin: 0; max-width: 24em; }
figcaption { display: grid; grid-template-columns: minmax(0, 1fr) minmax(0, 1fr);
  gap: 20px clamp(28px, 5vw, 64px); margin-top: clamp(24px, 3vw, 36px); }
h3 { font-size: 19px; font-weight: 620; letter-spacing: -0.012em; line-height: 1.3;
  margin-bottom: 8px; }
h3 span { color: var(--accent); margin-right: 0.7em; font-variant-numeric: tabular-nums; }
.what p { text-wrap: pretty; max-width: 36em; }
code { font: 0.88em/1.5 var(--mono); }
.what > p { color: var(--soft); }
.what code { color: var(--ink); }
pre { background: var(--raised); border-radius: 6px; padding: 16px 18px; line-height: 1.6;
  white-space: pre-wrap; overflow-wrap: anywhere; }
pre code { font-size: 13px; }
.how ul { list-style: none; padding: 0; margin-top: 12px; font-size: 13.5px; color: var(--soft); }
.how li { display: flex; gap: 16px; }
.how li span:first-child { color: var(--ink); font-weight: 600; flex: 0 0 4.6em;
  font-variant-numeric: tabular-nums; }
table { border-collapse: collapse; width: 100%; font-size: 14.5px; }
td { vertical-align: top; white-space: nowrap; }
td:last-child { white-space: normal; overflow-wrap: anywhere; color: var(--soft); }
th { color: var(--soft); font-weight: 500; text-align: left; }
th, td { padding: 11px 28px 11px 0; border-bottom: 1px solid var(--line); }
th:last-child, td:last-child { padding-right: 0; }
th:nth-child(2), td:nth-child(2), th:nth-child(3), td:nth-child(3) { text-align: right;
  font-variant-numeric: tabular-nums; }
@media (prefers-color-scheme: dark) { .ink img { filter: invert(1); } }
@media (max-width: 720px) {
  nav { padding: 18px 0; }
  .panels.n3 { grid-template-columns: minmax(0, 1fr); }
  figcaption { grid-template-columns: minmax(0, 1fr); }
  thead { display: none; }
  tr { display: grid; grid-template-columns: minmax(0, 1fr) auto; gap: 0 16px; padding: 11px 0;
    border-bottom: 1px solid var(--line); }
  td { padding: 0; border: none; white-space: normal; }
  td:nth-child(2)::after { content: " ms"; }
  td:nth-child(3)::after { content: " MP/s"; }
  td:nth-child(3) { grid-column: 2; grid-row: 2; color: var(--soft); }
  td:nth-child(4) { grid-column: 1; grid-row: 2; color: var(--soft); }
  td:last-child { grid-column: 1 / -1; }
}
@media (max-width: 460px) { .panels { grid-template-columns: minmax(0, 1fr); } }
@media (prefers-reduced-motion: reduce) { html { scroll-behavior: auto; } }
@media print { nav { display: none; } figure { break-inside: avoid; } }
"""
