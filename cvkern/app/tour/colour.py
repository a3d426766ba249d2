"""Colour, raw and high dynamic range: from samples behind a filter to a picture on a screen."""

from __future__ import annotations

import numpy as np

import cvkern
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.images import draw_lines

LAMP = np.array([1.0, 0.62, 0.3], np.float32)  # linear colour of an old bulb's light
STEPS = (-5, -3, -1, 1, 3)  # log2 of the exposures in seconds
RED = 2  # the paint whose spectrum is drawn
NOISE = 0.001  # standard deviation, as a share of white


def chapter() -> Chapter:
    """Return the chapter on colour, raw pictures and high dynamic range."""
    return Chapter(
        "colour",
        "Colour, raw and HDR",
        "A camera measures one colour at each pixel, under whatever light there is, and in fewer "
        "steps than a scene has. Three steps make a picture of that: fill in the colours, take the "
        "light out, and bring several exposures together. Before them, what a colour is at all.",
        (_univariance, _filled, _balanced, _exposures),
    )


def _shown(linear: np.ndarray) -> np.ndarray:
    return cvkern.convert_color(linear, "rgb", "srgb", dtype=np.uint8)


def _enlarged(image: np.ndarray, times: int) -> np.ndarray:
    return image.repeat(times, axis=0).repeat(times, axis=1)


def _univariance(_: Clock) -> Figure:
    waves = np.arange(380.0, 781.0, 5.0)
    paints = cvkern.color_chart(waves).values.T[12:18]
    twins = np.stack([cvkern.metamer(paint, "D65", "A") for paint in paints])
    apart = [
        cvkern.metameric_difference(paint, twin, "A")
        for paint, twin in zip(paints, twins, strict=True)
    ]

    def patches(light: str) -> np.ndarray:
        """Show the paints above, and beneath them those that look alike by day."""
        xyz = cvkern.spectrum_to_xyz(np.stack([paints, twins]), waves, light=light)
        codes = cvkern.convert_color(xyz, "xyz", "srgb", adapt=(light, "D65"), dtype="uint8")
        return _enlarged(codes, 70)

    plot = np.full((140, 420, 3), 255, np.uint8)
    columns = np.linspace(4, plot.shape[1] - 5, len(waves))
    for spectrum, color in ((paints[RED], (200, 40, 40)), (twins[RED], (40, 40, 200))):
        rows = 4 + (plot.shape[0] - 9) * (1 - spectrum)
        ends = np.stack([rows, columns], axis=1)
        plot = draw_lines(plot, np.hstack([ends[:-1], ends[1:]]), color=color, width=2)
    return Figure(
        "Two paints, one colour",
        "A cone of the eye answers a photon in one way, whatever its wavelength: this is the "
        "principle of univariance. All that is left of a spectrum are the answers of three kinds "
        "of cones, so paints of very different spectra look the same. Below each of six paints is "
        "such a twin. By day nothing tells them apart. In the light of a lamp they differ by "
        f"{min(apart):.0f} to {max(apart):.0f} (CIEDE2000; a difference of one is hardly seen).",
        'twin = cvkern.metamer(paint, "D65", "A")\ncvkern.metameric_difference(paint, twin, "A")',
        (
            Panel("colour-spectra", plot, "the red paint and its twin, 380 to 780 nm"),
            Panel("colour-day", patches("D65"), "six paints and their twins by day"),
            Panel("colour-night", patches("A"), "the same in the light of a lamp"),
        ),
    )


def _filled(clock: Clock) -> Figure:
    from skimage import data

    image = data.astronaut()[0:260, 150:410]
    raw = cvkern.mosaic(image)
    plain = clock(cvkern.demosaic, raw, method="bilinear")
    found = clock(cvkern.demosaic, raw)
    place = (slice(96, 166), slice(26, 96))
    samples = np.zeros_like(image)
    for y, x, c in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        samples[y::2, x::2, c] = raw[y::2, x::2]

    def ratio(picture: np.ndarray) -> float:
        inner = (slice(8, -8), slice(8, -8))
        off = picture[inner].astype(np.float64) - image[inner]
        return 10 * np.log10(255**2 / np.mean(off**2))

    return Figure(
        "The colours between the samples",
        "Behind each pixel is one colour of a Bayer filter. Means of neighbours blur edges and "
        "leave coloured fringes on them. The default interpolates what is left after a "
        "prediction by the other colours, which is smoother than the colours themselves.",
        "raw = cvkern.mosaic(image)\ncolours = cvkern.demosaic(raw)",
        (
            Panel("colour-samples", _enlarged(samples[place], 5), "the samples", pixelated=True),
            Panel("colour-bilinear", _enlarged(plain[place], 5),
                  f"means of neighbours: {ratio(plain):.1f} dB", pixelated=True),
            Panel("colour-residual", _enlarged(found[place], 5),
                  f"the default: {ratio(found):.1f} dB", pixelated=True),
        ),
        clock.take(),
    )  # fmt: skip


def _balanced(clock: Clock) -> Figure:
    from skimage import data

    linear = cvkern.convert_color(data.astronaut()[:420], "srgb", "rgb")
    lit = linear * LAMP
    light = clock(cvkern.estimate_illuminant, lit)
    balanced = clock(cvkern.white_balance, lit, light)
    off = np.degrees(np.arccos(light @ LAMP / np.linalg.norm(light) / np.linalg.norm(LAMP)))
    gain = np.mean(linear) / np.mean(balanced)
    return Figure(
        "The colour of the light, taken out",
        "A warm lamp colours all that it shines on, and the eye hardly sees this. The light is "
        "estimated from pixels whose channels change alike, from edges and from what is "
        f"brightest: the estimate is off by {off:.1f} degrees of the lamp that was put in.",
        "light = cvkern.estimate_illuminant(linear)\n"
        "balanced = cvkern.white_balance(linear, light)",
        (
            Panel("colour-lamp", _shown(lit), "in the light of a lamp"),
            Panel("colour-balanced", _shown((gain * balanced).clip(0, 1)), "with its colour out"),
        ),
        clock.take(),
    )


def _exposures(clock: Clock) -> Figure:
    from skimage import data

    scene = cvkern.convert_color(data.chelsea()[:, 20:], "srgb", "rgb")
    # The sun lies on one side, and deep shadow on the other: 2^9 between them.
    columns = np.linspace(-1, 1, scene.shape[1], dtype=np.float32)
    scene = scene * np.exp2(4.5 * np.tanh(4 * columns))[None, :, None]
    rng = np.random.default_rng(0)
    seconds = np.exp2(np.array(STEPS, np.float64))
    frames = []
    for time in seconds:
        light = scene * time + NOISE * rng.standard_normal(scene.shape)
        frames.append(_shown(light))
    images = np.stack(frames)
    fused = clock(cvkern.fuse_exposures, images)
    curve = cvkern.estimate_response(images, seconds)
    radiance = clock(cvkern.merge_exposures, images, seconds, response=curve)
    toned = clock(cvkern.tone_map, radiance, method="local_laplacian")
    return Figure(
        "Several exposures become one picture",
        f"The right side is {2**9} times as bright as the left. {len(STEPS)} frames hold "
        "it all. They are fused by how well each pixel is exposed, or merged to radiance, whose "
        "edges are then shrunk at every scale while the details are kept.",
        "fused = cvkern.fuse_exposures(images)\n"
        "curve = cvkern.estimate_response(images, seconds)\n"
        "radiance = cvkern.merge_exposures(images, seconds, response=curve)\n"
        'shown = cvkern.tone_map(radiance, method="local_laplacian")',
        (
            Panel("colour-short", images[0], f"the shortest, 1/{2 ** -STEPS[0]} second"),
            Panel("colour-long", images[-1], f"the longest, {2 ** STEPS[-1]} seconds"),
            Panel("colour-fused", np.rint(255 * fused).astype(np.uint8), "fused"),
            Panel("colour-toned", _shown(toned), "merged and tone mapped"),
        ),
        clock.take(),
    )
