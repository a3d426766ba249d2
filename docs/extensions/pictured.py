"""The directive ``pictured``: code that the page shows, and the pictures that it makes.

The code runs when Sphinx reads the page. It can use NumPy as ``np``, ``cvkern``, scikit-image's
``data`` and ``show(*images)``, and all names that earlier blocks of the page define. An error in it
fails the build. The argument is the caption. With the option ``hidden`` the code is not shown.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.util.docutils import SphinxDirective

FOLDER = "_generated/pictures"
HEIGHT = 300  # pixels of a row, unless the option ``height`` says otherwise
GAP = 10  # pixels between the panels of a row


def panel(image: Any, height: int) -> np.ndarray:
    """Return a picture as (height, W, 3) uint8: masks black on white, small values dark."""
    from skimage.transform import resize

    image = np.asarray(image)
    if image.dtype == bool:
        image = np.where(image, np.uint8(25), np.uint8(255))
    elif image.dtype != np.uint8 and image.ndim == 3:
        image = np.round(255 * image.clip(0, 1)).astype(np.uint8)
    elif image.dtype != np.uint8:
        low, high = np.nanmin(image), np.nanmax(image)
        image = np.round(255 * (image - low) / max(high - low, 1e-9)).astype(np.uint8)
    if image.ndim == 2:
        image = np.repeat(image[..., None], 3, axis=2)
    scale = height / image.shape[0]
    if scale != 1:
        size = (height, round(image.shape[1] * scale))
        image = resize(image, size, order=1, anti_aliasing=scale < 1, preserve_range=True)
    return np.round(image).astype(np.uint8)


def row(images: list[np.ndarray]) -> np.ndarray:
    """Return panels side by side, as (H, W, 4) with transparent gaps."""
    parts = []
    for image in images:
        opaque = np.full((*image.shape[:2], 1), 255, np.uint8)
        gap = np.zeros((image.shape[0], GAP, 4), np.uint8)
        parts += [np.concatenate((image, opaque), axis=2), gap]
    return np.hstack(parts[:-1])


class Pictured(SphinxDirective):
    """Run the code, write what it showed, and put both on the page."""

    has_content = True
    optional_arguments = 1
    final_argument_whitespace = True
    option_spec: ClassVar[Any] = {
        "alt": directives.unchanged_required,
        "height": directives.positive_int,
        "hidden": directives.flag,
    }

    def run(self) -> list[nodes.Node]:
        """Return the code, as a block, and a figure for each row of pictures."""
        code = "\n".join(self.content)
        options: dict[str, Any] = self.options or {}
        files: list[str] = []
        height = options.get("height", HEIGHT)

        def show(*images: Any) -> None:
            digest = hashlib.sha256(f"{self.env.docname} {code} {len(files)}".encode())
            name = f"{self.env.docname.replace('/', '-')}-{digest.hexdigest()[:10]}.webp"
            target = Path(self.env.srcdir, FOLDER, name)
            target.parent.mkdir(parents=True, exist_ok=True)
            _write(target, row([panel(image, height) for image in images]))
            files.append(name)

        known: Any = self.env.temp_data.setdefault("pictured", _names())
        known["show"] = show
        try:
            exec(compile(code, f"{self.env.docname} line {self.lineno}", "exec"), known)
        except Exception as error:
            raise self.error(f"the code of a picture failed: {error!r}") from error
        made: list[nodes.Node] = []
        if "hidden" not in options:
            made.append(nodes.literal_block(code, code, language="python"))
        for name in files:
            image = nodes.image(uri=f"/{FOLDER}/{name}", alt=options.get("alt", ""))
            figure = nodes.figure("", image, classes=["pictured"])
            if self.arguments and name == files[-1]:
                caption, _ = self.parse_inline(self.arguments[0])
                figure += nodes.caption("", "", *caption)
            made.append(figure)
        return made


def _names() -> dict[str, Any]:
    from skimage import data

    import cvkern

    return {"np": np, "cvkern": cvkern, "data": data}


def _write(target: Path, image: np.ndarray) -> None:
    from PIL import Image

    Image.fromarray(image).save(target, quality=82, method=4)


def setup(app: Any) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("pictured", Pictured)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
