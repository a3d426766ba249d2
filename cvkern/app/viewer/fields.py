"""A radiance field, seen from where the user stands, while it trains and afterwards.

While a camera moves, a picture has only as many pixels as are rendered in `COARSE` seconds; when
the camera stands still, it is rendered again with more.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from cvkern.app.viewer.server import HOST, PORT, Page
from cvkern.radiance.models import Model
from cvkern.radiance.pinhole import Cameras
from cvkern.radiance.rendering import render
from cvkern.radiance.scenes._colmap import rotation_of
from cvkern.radiance.scenes.photographs import focus_of

Callback = Callable[[int, float, Model], Any]
MOST = 2**20  # pixels of a picture
COARSE, FINE = 1 / 20, 1.0  # seconds for a picture while the camera moves, and afterwards
STILL = 0.3  # seconds after which a camera stands still


class FieldPage:
    """The page of a field. All pictures are made by `serve`, in the thread that calls it."""

    def __init__(self, views: Cameras, host: str = HOST, port: int = PORT) -> None:
        self.page = Page(host, port)
        self.views = views
        self.rate = 2e5  # pixels a second
        self.moved: dict[int, float] = {}  # when the camera of a client moved last
        self.shown: dict[int, tuple[Any, ...]] = {}  # what it was shown last
        self.text = self.page.server.gui.add_markdown("")
        self.size = self.page.server.gui.add_slider(
            "Largest side", min=128, max=2048, step=64, initial_value=1024
        )
        self.size.on_update(self.page.ask)
        self.page.server.on_client_connect(self._welcome)
        self.page.server.on_client_disconnect(self._forget)

    def _welcome(self, client: Any) -> None:
        """Let a client stand where the first photograph was taken."""
        poses = self.views.poses
        position = poses[0, :, 3]
        focus = focus_of(poses)
        up = -poses[:, :, 1].mean(axis=0)
        camera = client.camera
        camera.up_direction = up / np.linalg.norm(up)
        camera.position = position
        # Far enough away that dragging turns about the scene.
        ahead = poses[0, :, 2] * max(float(poses[0, :, 2] @ (focus - position)), 1e-3)
        camera.look_at = position + ahead
        camera.fov = 2 * math.atan(self.views.height / 2 / self.views.intrinsics[0, 1])

        def note(_: Any) -> None:
            self.moved[client.client_id] = time.monotonic()
            self.page.ask()

        camera.on_update(note)
        note(camera)

    def _forget(self, client: Any) -> None:
        self.moved.pop(client.client_id, None)
        self.shown.pop(client.client_id, None)

    def serve(self, model: Model, text: str = "") -> bool:
        """Draw the views of clients, coarsely while they move; return whether to draw more."""
        if text != self.text.content:
            self.text.content = text
        more = False
        for number, client in self.page.server.get_clients().items():
            moved = self.moved.get(number)
            if moved is None:
                continue
            moving = time.monotonic() - moved < STILL
            # A picture may take a moment while the camera moves, and longer when it stands still.
            most = min(MOST, self.rate * (COARSE if moving else FINE))
            aspect = max(client.camera.aspect, 1 / client.camera.aspect)
            wanted = max(min(int(self.size.value), int(math.sqrt(most * aspect))), 16)
            state = moved, moving, model.training.step, self.size.value
            if self.shown.get(number) != state:
                self._draw(client, model, wanted)
                self.shown[number] = state
            more |= moving
        if more:
            time.sleep(0.01)
        return more

    def _draw(self, client: Any, model: Model, side: int) -> None:
        camera = client.camera
        aspect = camera.aspect
        width, height = (side, round(side / aspect)) if aspect > 1 else (round(side * aspect), side)
        width, height = max(width, 1), max(height, 1)
        focal = height / 2 / math.tan(camera.fov / 2)
        pose = np.column_stack((rotation_of(camera.wxyz), camera.position))
        lens = np.array([[focal, focal, (width - 1) / 2, (height - 1) / 2]])
        view = Cameras(pose[None], lens, np.zeros((1, 5)), width, height)
        begin = time.perf_counter()
        try:
            seen = render(model, view).color
        except ValueError:  # the camera is too far away
            return
        self.rate = 0.5 * self.rate + 0.5 * width * height / (time.perf_counter() - begin)
        pixels = (255 * seen).round().astype(np.uint8)
        client.scene.set_background_image(pixels, format="jpeg", jpeg_quality=90)


@contextmanager
def shown_while_training(
    model: Model, callback: Callback | None, say: Callable[[str], object]
) -> Iterator[Callback]:
    """Open the page of a model, and yield a callback that draws it and calls `callback`."""
    field = FieldPage(model.cameras)
    say(f"{field.page.address}: open it in a browser")

    def serve(step: int, loss: float, model: Model) -> Any:
        quality = -10 * math.log10(max(loss, 1e-10))
        field.serve(model, f"Step {step:,}, {quality:.1f} dB on the photographs")
        return callback(step, loss, model) if callback else None

    try:
        yield serve
    finally:
        field.page.close()
