"""Shading: a rendered body, and its shape from images under several lights."""

from __future__ import annotations

import numpy as np

import cvkern
from cvkern.app.commands.relief import relit
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel

SIDE, VASE = 200, 120  # pixels
GLOSS, SHARP = 0.9, 40  # how bright highlights are, and how small
HELD = 20  # the angle in degrees that errors are shown up to


def chapter() -> Chapter:
    """Return the chapter on shading."""
    return Chapter(
        "shading",
        "Shape from shading",
        "How bright a surface is tells how it is turned to the light. Several images under known "
        "lights give the direction of each pixel, and these add up to depth.",
        (_rendered, _stereo, _alone),
    )


def _mask() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return depth of a face-like relief, where it is, and its albedo."""
    y, x = np.indices((SIDE, SIDE)) - (SIDE - 1) / 2
    inside = (x / 76) ** 2 + (y / 94) ** 2 < 1
    height = 60 * np.sqrt(np.maximum(1 - (x / 80) ** 2 - (y / 98) ** 2, 0))

    def bump(row: float, column: float, tall: float, high: float, wide: float) -> np.ndarray:
        return tall * np.exp(-(((y - row) / high) ** 2) - ((x - column) / wide) ** 2)

    height += bump(8, 0, 26, 26, 10) + bump(-34, 0, 7, 7, 44) + bump(52, 0, 6, 6, 18)
    height -= bump(-16, -30, 14, 11, 16) + bump(-16, 30, 14, 11, 16) + bump(44, 0, 3, 3, 22)
    stripe = np.where((np.abs(y + 62) < 6) | (np.abs(np.abs(x) - 48) < 5), 0.45, 0.85)
    return np.where(inside, -height, np.nan), inside, stripe


def _lamps(count: int) -> np.ndarray:
    """Return unit vectors that are spread over a cone around the view."""
    turns, slants = 2.4 * np.arange(count), 0.9 * np.sqrt((np.arange(count) + 0.5) / count)
    lamps = np.stack([slants * np.cos(turns), slants * np.sin(turns), np.ones(count)], axis=1)
    return lamps / np.linalg.norm(lamps, axis=1, keepdims=True)


def _photographs(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return images with shadows and gloss, their lights, true normals and the mask."""
    depth, inside, albedo = _mask()
    lamps = _lamps(count)
    images = cvkern.lambertian(depth, lamps, albedo=albedo, shadows="cast")
    normals = cvkern.normals_from_depth(depth)
    halves = lamps + np.array([0, 0, 1])
    halves /= np.linalg.norm(halves, axis=1, keepdims=True)
    shine = np.maximum(np.einsum("yxc,kc->kyx", np.nan_to_num(normals), halves), 0) ** SHARP
    return images + GLOSS * shine * (images > 0), lamps, normals, inside


def _grey(image: np.ndarray) -> np.ndarray:
    """Return a linear image for the screen."""
    return (255 * np.nan_to_num(image).clip(0, 1) ** (1 / 2.2)).round().astype(np.uint8)


def _rendered(clock: Clock) -> Figure:
    depth, _, albedo = _mask()
    lamps = _lamps(6)[[5, 3]]
    images = clock(cvkern.lambertian, depth, lamps, albedo=albedo, shadows="cast")
    sky = np.array([1.6, 1.3, 0.5, 0.4, 0, 0, 0, 0, 0])
    panels = [
        Panel(f"shading-lamp-{n}", _grey(image), text)
        for n, (image, text) in enumerate(
            zip(images, ("a lamp, with the shadows it casts", "another lamp"), strict=True)
        )
    ]
    seen = cvkern.lambertian(depth, sky, albedo=albedo)
    panels.append(Panel("shading-sky", _grey(seen), "a bright sky above, nine numbers"))
    return Figure(
        "A matt surface under lamps and a sky",
        "A depth map is rendered: brightness is the cosine between normal and light. Shadows are "
        "found by walking from each pixel to the light. A sky is given by nine harmonics, "
        "which is all that a matt surface sees of it.",
        'cvkern.lambertian(depth, lights, albedo=albedo, shadows="cast")',
        tuple(panels),
        clock.take(),
    )


def _stereo(clock: Clock) -> Figure:
    images, lamps, normals, inside = _photographs(24)
    found = clock(cvkern.photometric_stereo, images, lamps, mask=inside)
    plain = cvkern.photometric_stereo(images, lamps, mask=inside, method="least_squares")
    depth = cvkern.integrate_normals(found.normals, inside)
    off = []
    for one in (plain, found):
        cosines = np.einsum("yxc,yxc->yx", one.normals, normals).clip(-1, 1)
        off.append(np.degrees(np.arccos(cosines)))
    shown = np.nan_to_num(found.normals * 0.5 + 0.5)
    panels = (
        Panel("shading-photo", _grey(images[3]), "one of 24 images, with gloss and shadows"),
        Panel("shading-normals", (255 * shown).round().astype(np.uint8), "the normals found"),
        *(
            Panel(f"shading-{name}", _grey((angle / HELD) ** 2.2), f"{said}: {mean:.1f} degrees")
            for name, said, angle, mean in (
                ("plain", "least squares are off by", off[0], np.nanmean(off[0])),
                ("robust", "the default is off by", off[1], np.nanmean(off[1])),
            )
        ),
        Panel("shading-relit", relit(cvkern.normals_from_depth(depth), np.where(inside, 0.9, 0)),
              "the depth that they add up to, under a light that goes round"),
    )  # fmt: skip
    return Figure(
        "Normals from images under several lights",
        "Each pixel of a matt surface tells its normal by three lights. Here it is glossy and in "
        "shadow as well, which least squares take for the shape. The default takes each pixel in "
        "several windows of its brightness, and trusts those that fit. Errors are white from "
        f"{HELD} degrees on.",
        "found = cvkern.photometric_stereo(images, lights, mask=mask)\n"
        "depth = cvkern.integrate_normals(found.normals, mask)",
        panels,
        clock.take(),
    )


def _alone(clock: Clock) -> Figure:
    y, x = np.indices((VASE, VASE)) - (VASE - 1) / 2
    radius = VASE * (0.25 + 0.09 * np.cos(7 * y / VASE + 0.7))
    inside = (np.abs(x) < radius) & (np.abs(y) < 0.46 * VASE)
    height = np.sqrt(np.maximum(radius**2 - x**2, 0))
    bend = -0.63 * np.sin(7 * y / VASE + 0.7)
    normals = np.stack([x, radius * bend, height], axis=-1)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
    light = np.array([-0.2, 0.1, 0.97]) / np.linalg.norm([-0.2, 0.1, 0.97])
    image = cvkern.lambertian(np.where(inside[..., None], normals, np.nan), light)
    found = clock(cvkern.shape_from_shading, image, light, mask=inside)
    cosines = np.einsum("yxc,yxc->yx", np.nan_to_num(found.normals), normals).clip(-1, 1)
    off = np.degrees(np.arccos(cosines[inside])).mean()
    other = cvkern.lambertian(found.normals, [0.7, 0.2, 0.68])
    shown = np.nan_to_num(found.normals * 0.5 + 0.5)
    return Figure(
        "The shape of one image",
        "One image leaves each normal on a cone around the light. The silhouette, where the "
        "surface turns away, and the neighbours of each pixel tell the rest: the normals are off "
        f"by {off:.1f} degrees in the mean.",
        "normals, depth = cvkern.shape_from_shading(image, light, mask=mask)",
        (
            Panel("shading-vase", _grey(image), "the image"),
            Panel("shading-vase-normals", (255 * shown).round().astype(np.uint8), "its normals"),
            Panel("shading-vase-relit", _grey(other), "lit from the other side"),
        ),
        clock.take(),
    )
