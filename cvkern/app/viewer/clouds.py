"""A cloud of points."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern.app.viewer.server import HOST, PORT, Page

MOST = 2_000_000  # points that a browser draws well


def cloud_page(
    points: np.ndarray, colors: np.ndarray | None, host: str = HOST, port: int = PORT
) -> Page:
    """Show points (x right, y down, z forward, as cameras have it) with a slider for their size."""
    page = Page(host, port)
    server = page.server
    if len(points) > MOST:
        chosen = np.random.default_rng(0).choice(len(points), MOST, replace=False)
        points, colors = points[chosen], None if colors is None else colors[chosen]
    low, high = np.percentile(points, (2, 98), axis=0)
    middle, extent = (low + high) / 2, float(np.linalg.norm(high - low)) or 1.0
    width = extent / max(2 * len(points) ** 0.5, 200)  # the side of a point
    server.scene.set_up_direction((0.0, -1.0, 0.0))
    shade = np.full((len(points), 3), 200, np.uint8) if colors is None else colors
    cloud = server.scene.add_point_cloud(
        "/points", points.astype(np.float32), shade, point_size=width, precision="float32"
    )
    size = server.gui.add_slider("Size of points", min=0.1, max=5.0, step=0.1, initial_value=1.0)
    server.gui.add_markdown(f"{len(points):,} points")

    @size.on_update
    def _(_: Any) -> None:
        cloud.point_size = width * size.value

    @server.on_client_connect
    def _(client: Any) -> None:
        client.camera.position = middle - np.array([0, 0, 1.2 * extent])
        client.camera.look_at = middle

    return page
