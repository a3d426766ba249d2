"""A figure of radiance fields: photographs of changing light, with passers-by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cvkern.app.tour.page import Figure, Panel
from cvkern.radiance import (
    Scene,
    VoxelField,
    fit,
    make_scene,
    psnr,
    render,
    render_transient,
)
from cvkern.radiance.rendering import film, photograph

STEPS = 600  # steps of each training
ENLARGED = 4
SHOWN = 8  # photographs of the sheet
FRAMES = 24  # frames of the film


def figure() -> Figure:
    """Train with and without a model of light and crowds, and show what each part keeps."""
    scene, hidden = _crowded(make_scene(train=30, test=2, size=48))
    field = VoxelField(resolutions=(16, 32), shares=(0.3,), rays=2048)
    options = {"steps": STEPS, "background": "white", "progress": False}
    plain = fit(scene, field, **options)
    model = fit(scene, field, appearance="affine", transient=True, **options)
    view = int(np.flatnonzero(scene.test)[0])
    truth = photograph(scene, view, model.behind)
    seen = [render(m, scene.cameras, view).color for m in (plain, model)]
    trained = np.flatnonzero(~scene.test)
    busy = int(trained[np.argmax(hidden[trained].sum(axis=(1, 2)))])
    passing = render_transient(model, busy)
    opacity = passing.opacity[..., None]
    taken = opacity * passing.color + (1 - opacity)
    lights = model.appearances[trained[:: len(trained) // 4][:4]]
    share = np.linspace(0, 4, FRAMES, endpoint=False)[:, None, None]
    at, after = share.astype(int)[:, 0, 0], (share.astype(int)[:, 0, 0] + 1) % 4
    between = (1 - share % 1) * lights[at] + share % 1 * lights[after]
    still = scene.cameras.select(np.full(FRAMES, view))
    sheet = [photograph(scene, v, model.behind) for v in trained[1 : SHOWN + 1]]
    return Figure(
        "Changing light and passers-by",
        "Photographs of one place by many people: the light differs, and somebody is in the way. "
        "`appearance` learns a map of colours for each photograph, and `transient` what passes in "
        f"front of it. The field without both has {psnr(seen[0], truth):.1f} dB in a held-out "
        f"view, with both {psnr(seen[1], truth):.1f} dB.",
        'model = fit(scene, appearance="affine", transient=True)\n'
        "passing = render_transient(model, view)\n"
        "render(model, cameras, appearance=(model.appearances[3] + model.appearances[7]) / 2)",
        (
            Panel("crowds-photographs", _sheet(sheet), "Photographs to learn from"),
            Panel("crowds-plain", _large(seen[0]), "A held-out view, learnt without"),
            Panel("crowds-kept", _large(seen[1]), "What the field keeps"),
            Panel(
                "crowds-photograph",
                _large(photograph(scene, busy, model.behind)),
                "One of the photographs",
            ),
            Panel("crowds-taken", _large(taken), "What the head takes from it"),
            Panel(
                "crowds-lights",
                np.stack([_large(f / 255) for f in film(model, still, appearance=between)]),
                "`render_path` through the light of four photographs",
            ),
        ),
    )


def _crowded(scene: Scene) -> tuple[Scene, np.ndarray]:
    """Return the scene with its light changed and passers-by, and where they are, (N, H, W)."""
    images, rng = scene.images.copy(), np.random.default_rng(5)
    hidden = np.zeros(images.shape[:3], bool)
    height, width = images.shape[1:3]
    y, x = np.mgrid[:height, :width] / height
    for view in np.flatnonzero(~scene.test)[1:].tolist():
        colors = rng.uniform(0.75, 1.25, 3) * (images[view, ..., :3] / 255)
        images[view, ..., :3] = np.round(255 * (colors + rng.uniform(-0.1, 0.1, 3)).clip(0, 1))
        for _ in range(rng.integers(1, 3)):
            middle, top = rng.uniform(0.15, 0.85), rng.uniform(0.25, 0.5)
            head = np.hypot(x - middle, y - top) < 0.05
            body = (np.abs(x - middle) < 0.075) & (y > top + 0.04) & (y < top + 0.4)
            for part in (body, head):
                images[view][part] = *rng.integers(20, 236, 3), 255
                hidden[view] |= part
    return replace(scene, images=images), hidden


def _large(color: np.ndarray) -> np.ndarray:
    shown = np.round(255 * color).astype(np.uint8)
    return np.kron(shown, np.ones((ENLARGED, ENLARGED, 1), np.uint8))


def _sheet(pictures: list[np.ndarray]) -> np.ndarray:
    """Return pictures in rows of four."""
    rows = [np.hstack(pictures[i : i + 4]) for i in range(0, len(pictures), 4)]
    return np.kron(np.round(255 * np.vstack(rows)).astype(np.uint8), np.ones((3, 3, 1), np.uint8))
