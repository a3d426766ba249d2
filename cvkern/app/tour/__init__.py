"""The tour: every family on sample photographs, as pictures, timings and one HTML page.

A family adds a chapter as a module of this package with a function ``chapter() -> Chapter``, listed
in `CHAPTERS`.
"""

from __future__ import annotations

import importlib.util
import json
import os
import platform
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import cvkern
from cvkern._files import replacing, write_text
from cvkern._runtime import runtime
from cvkern.app.tour import (
    circles,
    colour,
    edges,
    features,
    lines,
    page,
    pair,
    panorama,
    radiance,
    recognition,
    reconstruction,
    scanning,
    shading,
    shapes,
    stereo,
)
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure

__all__ = ["CHAPTERS", "tour"]

QUALITY = 85  # WebP quality of photographs and films
SHARP = 1.3  # a lossless file is used if it is at most this many times as large
FRAME_MILLISECONDS = 50

CHAPTERS: tuple[Callable[[], Chapter], ...] = (
    edges.chapter, lines.chapter, circles.chapter, shapes.chapter, features.chapter,
    panorama.chapter, recognition.chapter, stereo.chapter, pair.chapter, scanning.chapter,
    colour.chapter, shading.chapter, reconstruction.chapter, radiance.chapter,
)  # fmt: skip


def tour(
    folder: str | os.PathLike[str],
    *,
    chapters: tuple[Callable[[], Chapter], ...] = CHAPTERS,
    progress: Callable[[int, int, str], None] | None = None,
) -> Path:
    """Compute every figure and write ``index.html``, ``timings.json`` and a file per picture.

    All figures are computed before anything is written, and each file is replaced whole.

    Parameters
    ----------
    folder : path
        Created if missing. Files with other names in it are left unchanged.
    chapters : tuple of functions
        Each returns a `Chapter`.
    progress : function, optional
        Called with the number of figures done, the number of all, and the title of the next.

    Returns
    -------
    path
        The page.

    Raises
    ------
    ModuleNotFoundError
        If scikit-image, which brings the photographs, is not installed.
    ValueError
        If `folder` is a file.
    """
    if importlib.util.find_spec("skimage") is None:
        raise ModuleNotFoundError(
            "the tour needs the photographs of scikit-image: pip install 'cvkern[demo]'"
        )
    target = Path(folder)
    if target.exists() and not target.is_dir():
        raise ValueError(f"folder must be a folder, got the file {str(target)!r}")
    made = [chapter() for chapter in chapters]
    total, done = sum(len(chapter.figures) for chapter in made), 0
    clock = Clock()
    results: list[tuple[Chapter, list[Figure]]] = []
    for chapter in made:
        figures = []
        for figure in chapter.figures:
            if progress:
                progress(done, total, chapter.title)
            figures.append(figure(clock))
            done += 1
        results.append((chapter, figures))
    if progress:
        progress(total, total, "Writing")
    panels = [panel for _, figures in results for figure in figures for panel in figure.panels]
    pictures = {panel.file: _encoded(panel.image) for panel in panels}
    text = page.render(results, _facts())
    target.mkdir(parents=True, exist_ok=True)
    for name, file in pictures.items():
        with replacing(target / f"{name}.webp") as beside:
            beside.write_bytes(file)
    write_text(target / "timings.json", json.dumps(_timings(results), indent=2) + "\n")
    write_text(target / "index.html", text)
    return target / "index.html"


def _encoded(image: np.ndarray) -> bytes:
    """Return a WebP file, lossless if that costs little, as for masks and plots."""
    import imageio.v3 as iio

    def written(**options: Any) -> bytes:
        return iio.imwrite("<bytes>", image, extension=".webp", plugin="pillow", **options)

    if image.ndim == 4:
        return written(quality=QUALITY, duration=FRAME_MILLISECONDS, loop=0)
    lossy, sharp = written(quality=QUALITY), written(lossless=True)
    return sharp if len(sharp) <= SHARP * len(lossy) else lossy


def _facts() -> dict[str, str]:
    """Return versions and devices, by name."""
    rt = runtime()
    return {
        "Kernels": rt.name.capitalize(),
        "Device": rt.device.upper().replace(":", " "),
        "Machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "cvkern": cvkern.__version__,
        "Python": platform.python_version(),
        "NumPy": np.__version__,
    }


def _timings(results: list[tuple[Chapter, list[Figure]]]) -> dict[str, object]:
    calls = [
        {"chapter": chapter.name, "figure": figure.title, **asdict(timing)}
        for chapter, figures in results
        for figure in figures
        for timing in figure.timings
    ]
    return {"made_with": _facts(), "timings": calls}
