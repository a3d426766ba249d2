"""A photograph under a detector whose parameters are sliders, and maps of values."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

import cvkern
from cvkern.app.viewer.server import HOST, PORT, Page, fitted, framed
from cvkern.images import apply_colormap, draw_circles, draw_lines, overlay_mask

KINDS = "edges", "segments", "circles", "photograph"


class PhotographPage:
    """A photograph, and what a detector finds in it for the values of the sliders."""

    def __init__(self, image: np.ndarray, host: str = HOST, port: int = PORT) -> None:
        self.page = Page(host, port)
        self.image, self.picture = image, as_bytes(image)
        gui = self.page.server.gui
        radius = min(max(min(image.shape[:2]) // 2, 8), 400)
        self.controls = {
            "kind": gui.add_dropdown("Find", KINDS),
            "sigma": gui.add_slider("Sigma", 0.5, 8.0, 0.1, 1.5),
            "low": gui.add_slider("Low quantile", 0.0, 1.0, 0.005, 0.7),
            "high": gui.add_slider("High quantile", 0.0, 1.0, 0.005, 0.9),
            "length": gui.add_slider("Shortest segment", 5, 200, 1, 20),
            "radii": gui.add_multi_slider(
                "Radii", 3, radius, 1, (max(radius // 6, 3), radius // 2)
            ),
            "support": gui.add_slider("Support of a circle", 0.1, 1.0, 0.01, 0.5),
        }
        self.text = gui.add_markdown("")
        for control in self.controls.values():
            control.on_update(self.page.ask)
        self.found, self.state = self.picture, {}
        show(self.page, lambda: self.found)
        self.page.ask()

    def serve(self) -> bool:
        """Run the detector with the values of the controls; return False, because all is drawn."""
        state = {name: control.value for name, control in self.controls.items()}
        if state == self.state:
            return False
        self.state = state
        begin = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                self.found, said = self._find(**state)
            except ValueError as error:  # the values do not fit together
                self.text.content = str(error)
                return False
        self.text.content = f"{said}, {1e3 * (time.perf_counter() - begin):.0f} ms"
        for client in self.page.server.get_clients().values():
            draw(client, self.found)
        return False

    def _find(
        self,
        kind: str,
        sigma: float,
        low: float,
        high: float,
        length: float,
        radii: tuple[float, float],
        support: float,
    ) -> tuple[np.ndarray, str]:
        if kind == "edges":
            edges = cvkern.canny(
                self.image, sigma, low, max(low, high), use_quantiles=True, operator="gaussian"
            )
            return overlay_mask(self.picture, edges), f"edge pixels: {int(edges.sum()):,}"
        if kind == "segments":
            found = cvkern.detect_segments(
                self.image, sigma, low, max(low, high), use_quantiles=True, min_length=length
            )
            return draw_lines(self.picture, found), f"segments: {len(found)}"
        if kind == "circles":
            centers, sizes, _ = cvkern.detect_circles(
                self.image, radii, sigma=sigma, min_support=support
            )
            circles = np.column_stack((centers, sizes))
            return draw_circles(self.picture, circles, width=2), f"circles: {len(circles)}"
        return self.picture, "the photograph"


def map_page(
    values: np.ndarray, host: str = HOST, port: int = PORT, depth: np.ndarray | None = None
) -> Page:
    """Show a map of depths or disparities in colours; a click tells the value there.

    With the `depth` of disparities, it tells that too.
    """
    page = Page(host, port)
    picture = apply_colormap(values)
    text = page.server.gui.add_markdown("Click on a pixel to see its value.")
    show(page, lambda: picture)
    rows, columns = values.shape

    @page.server.scene.on_click()
    def _(event: Any) -> None:
        height, width, top, left = framed(rows, columns, event.client.camera.aspect)
        x, y = event.screen_pos
        row, column = int(y * height) - top, int(x * width) - left
        if 0 <= row < rows and 0 <= column < columns:
            far = "" if depth is None else f", depth **{depth[row, column]:.6g}**"
            text.content = f"row {row}, column {column}: **{values[row, column]:.6g}**{far}"

    return page


def as_bytes(image: np.ndarray) -> np.ndarray:
    """Return a photograph as (H, W, 3) uint8, with its largest value as white."""
    if image.dtype != np.uint8:
        most = float(np.nanmax(image, initial=0)) or 1.0
        image = (255 * np.nan_to_num(np.clip(image / most, 0, 1))).round().astype(np.uint8)
    if image.ndim == 2:
        return np.repeat(image[..., None], 3, axis=2)
    return np.ascontiguousarray(image[..., :3])


def show(page: Page, picture: Callable[[], np.ndarray]) -> None:
    """Show each client a picture that fills its window, and again when the window changes."""

    @page.server.on_client_connect
    def _(client: Any) -> None:
        last = [0.0]

        def note(camera: Any) -> None:
            if abs(camera.aspect - last[0]) > 1e-3:
                last[0] = camera.aspect
                draw(client, picture())

        client.camera.on_update(note)
        note(client.camera)


def draw(client: Any, picture: np.ndarray) -> None:
    """Send a picture to the window of a client."""
    client.scene.set_background_image(fitted(picture, client.camera.aspect), format="png")
