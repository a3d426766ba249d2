"""Radiance fields: a scene learnt from photographs, and seen from new places."""

from __future__ import annotations

import functools
import io
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cvkern.app.tour import crowds
from cvkern.app.tour.clock import Clock
from cvkern.app.tour.page import Chapter, Figure, Panel
from cvkern.clouds import write_ply
from cvkern.images.colors import apply_colormap
from cvkern.radiance import (
    Mark,
    Model,
    Picture,
    Scene,
    SplatField,
    VoxelField,
    cameras,
    fit,
    make_scene,
    orbit_cameras,
    planes_from_stereo,
    point_cloud,
    psnr,
    render,
)
from cvkern.radiance.rendering import film, photograph
from cvkern.radiance.trainer import FEW

SECONDS = 40.0  # training time
SPLATS, SPLAT_SECONDS = 8192, 6.0
SHEET = (4, 8)  # rows and columns of photographs
ENLARGED = 3
FRAMES, FACTOR = 40, 2.0  # frames of the orbit, and their enlargement
FOCAL = 497.5  # focal length of the halved pair, pixels
PALE, DARK = "#5f6368", "#a8431f"


class Made(NamedTuple):
    """The scene and the model that all figures share."""

    scene: Scene
    model: Model
    view: int
    """The held-out photograph that is shown."""


def chapter() -> Chapter:
    """Return the chapter on radiance fields; its figures share one scene and one model."""
    scene = functools.cache(make_scene)
    made = functools.cache(lambda: _made(scene()))
    return Chapter(
        "radiance",
        "Radiance fields",
        "A radiance field is like a fog: every point has a density and, for each viewing "
        "direction, a colour. Training marches along the rays of photographs, compares, and "
        "corrects the field, until it shows the scene from any viewpoint.",
        (
            lambda clock: _photographs(scene()),
            lambda clock: _learnt(clock, made()),
            lambda clock: _orbit(made()),
            lambda clock: _splats(clock, made()),
            lambda clock: crowds.figure(),
            lambda clock: _planes(),
        ),
    )


def _made(scene: Scene) -> Made:
    model = fit(scene, VoxelField(), seconds=SECONDS, evaluate_every=50, progress=False)
    kept = np.flatnonzero(scene.test)
    return Made(scene, model, int(kept[len(kept) // 2]))


def _photographs(scene: Scene) -> Figure:
    rows, columns = SHEET
    white = np.ones(3, np.float32)
    views = np.flatnonzero(~scene.test)[
        np.linspace(0, (~scene.test).sum() - 1, rows * columns).astype(int)
    ]
    photographs = [_bytes(photograph(scene, view, white)) for view in views]
    sheet = np.vstack([np.hstack(photographs[i : i + columns])
                       for i in range(0, rows * columns, columns)])  # fmt: skip
    count, kept = int((~scene.test).sum()), int(scene.test.sum())
    return Figure(
        "Photographs with known cameras",
        f"{rows * columns} of {count} photographs of {scene.cameras.height} x "
        f"{scene.cameras.width} pixels, from all sides; {kept} more are held out. The library "
        "renders them itself: solids given by distance functions, with soft shadows, and gloss "
        "that moves with the camera.",
        "scene = make_scene()\n# or photographs: load_scene(folder)",
        (Panel("radiance-photographs", sheet, "Photographs to learn from"),),
    )


def _learnt(clock: Clock, made: Made) -> Figure:
    scene, model, view = made
    *marks, last = model.training.marks  # the last mark uses more views, so the curve omits it
    wanted = photograph(scene, view, model.behind)

    def render_view(image: np.ndarray, view: int) -> Picture:
        return render(model, scene.cameras, view)

    render_view.__name__ = "render"
    seen = clock(render_view, wanted, view=view)
    off = np.abs(seen.color - wanted).mean(axis=2)
    return Figure(
        f"{last.step:,} steps later",
        f"After {last.seconds:.0f} s of training, renderings of the {int(scene.test.sum())} "
        f"held-out photographs have {last.test_psnr:.1f} dB and a structural similarity of "
        f"{last.test_ssim:.3f} on average. Where the curves dip, the grid of the field was "
        "refined; the gap between them shows how much the field overfits.",
        f"model = fit(scene, VoxelField(), seconds={SECONDS:g})\n"
        "picture = render(model, scene.cameras, view)",
        (
            Panel("radiance-truth", _large(wanted), "A held-out photograph"),
            Panel(
                "radiance-render",
                _large(seen.color),
                f"`render` of its camera: {psnr(seen.color, wanted):.1f} dB",
            ),
            Panel(
                "radiance-error",
                apply_colormap(np.kron(off, np.ones((ENLARGED,) * 2)), vmin=0, vmax=0.2),
                "Error: dark is right, bright is wrong by a fifth of the range",
            ),
            Panel(
                "radiance-curve",
                _curve(marks),
                f"Quality over the time of training, of rays and of {FEW} held-out views",
            ),
        ),
        clock.take(),
    )


def _orbit(made: Made) -> Figure:
    _, model, _ = made
    around = orbit_cameras(model.cameras, FRAMES, factor=FACTOR)
    depth = render(model, around, 0).depth
    return Figure(
        "Views without a camera",
        "A path around the scene at mean height and distance. The depth is the mean distance at "
        "which light is stopped along a ray. Marching cubes turn the density into a mesh.",
        "cameras = orbit_cameras(model.cameras, 40, factor=2)\n"
        'render_path(model, cameras, "orbit.gif")\n'
        "depth = render(model, cameras, 0).depth\n"
        'write_mesh("scene.ply", mesh(model))\n'
        'model.save("scene.npz")',
        (
            Panel("radiance-orbit", film(model, around), "`render_path`: new views"),
            Panel(
                "radiance-depth",
                apply_colormap(-depth, nan=(0, 0, 0)),
                f"Depth: from {np.nanmin(depth):.1f}, bright, to {np.nanmax(depth):.1f}",
            ),
        ),
    )


def _splats(clock: Clock, made: Made) -> Figure:
    scene, model, view = made
    with tempfile.TemporaryDirectory() as folder:
        points = str(Path(folder) / "points.ply")
        write_ply(points, *point_cloud(model))
        field = SplatField(SPLATS, start=points)
        drawn = fit(scene, field, seconds=SPLAT_SECONDS, progress=False)
    around = orbit_cameras(model.cameras, FRAMES, factor=FACTOR)

    def render_view(image: np.ndarray, view: int) -> Picture:
        return render(drawn, scene.cameras, view)

    render_view.__name__ = "render"
    seen = clock(render_view, photograph(scene, view, drawn.behind), view=view)
    mark = drawn.training.marks[-1]
    return Figure(
        f"{SPLATS} splats",
        "Soft ellipsoids that begin at points of the field above, and are drawn one over the "
        f"other, so a picture takes little time. After {mark.seconds:.0f} s, renderings of the "
        f"held-out photographs have {mark.test_psnr:.1f} dB on average.",
        'write_ply("points.ply", *point_cloud(model))\n'
        f'field = SplatField({SPLATS}, start="points.ply")\n'
        f"splats = fit(scene, field, seconds={SPLAT_SECONDS:g})\n"
        'write_splats("splats.ply", splats)  # for viewers of splats',
        (
            Panel("radiance-splats", film(drawn, around), "`render_path`: the same path"),
            Panel("radiance-splats-render", _large(seen.color), "`render` of a held-out camera"),
        ),
        clock.take(),
    )


def _planes() -> Figure:
    from skimage import data

    left, right, _ = data.stereo_motorcycle()
    left, right = (photo[::2, ::2] for photo in (left, right))
    height, width = left.shape[:2]
    K = [[FOCAL, 0, (width - 1) / 2], [0, FOCAL, (height - 1) / 2], [0, 0, 1]]
    model = planes_from_stereo(left, right, K, disparities=(0, 32))
    angles = np.linspace(0, 2 * np.pi, FRAMES, endpoint=False)
    eyes = np.column_stack((0.6 * np.cos(angles), 0.25 * np.sin(angles), 0 * angles))
    poses = np.concatenate((np.tile(np.eye(3), (FRAMES, 1, 1)), eyes[:, :, None]), axis=2)
    around = cameras(poses, model.cameras.intrinsics[0], width, height)
    depth = render(model, model.cameras).depth
    return Figure(
        "A pair of photographs that moves",
        "A multiplane image: the disparities of a stereo pair cut its left photograph into 32 "
        "parallel planes, and surfaces go on behind nearer ones. There is no training.",
        "model = planes_from_stereo(left, right, K, disparities=(0, 32))\n"
        'write_planes(model, "planes.html")  # a page that follows the mouse',
        (
            Panel("radiance-planes", film(model, around), "`render_path`: from around the camera"),
            Panel(
                "radiance-planes-depth",
                apply_colormap(1 / depth, nan=(0, 0, 0)),
                "Inverse depth of the planes: bright is near",
            ),
        ),
    )


def _bytes(color: np.ndarray) -> np.ndarray:
    return np.round(255 * color).astype(np.uint8)


def _large(color: np.ndarray) -> np.ndarray:
    return np.kron(_bytes(color), np.ones((ENLARGED, ENLARGED, 1), np.uint8))


def _curve(marks: list[Mark]) -> np.ndarray:
    """Draw the quality over the time of training, (H, W, 3) uint8."""
    import imageio.v3 as iio
    import matplotlib
    from matplotlib.figure import Figure as Plot

    seconds = [mark.seconds for mark in marks]
    with matplotlib.rc_context({"font.size": 11}):
        plot = Plot(figsize=(6.0, 6.0), dpi=100)
        panel = plot.subplots()
        batches = [mark.psnr for mark in marks]
        panel.plot(seconds, batches, color=PALE, linewidth=1.2, label="trained from")
        kept = [mark.test_psnr for mark in marks]
        panel.plot(seconds, kept, color=DARK, marker="o", markersize=4, label="held out")
        panel.set_xlabel("training, seconds")
        panel.set_ylabel("peak signal-to-noise ratio, dB")
        panel.set_xlim(left=0)
        panel.grid(color="#e3e5e8", linewidth=0.6)
        panel.set_axisbelow(True)
        panel.spines[["top", "right"]].set_visible(False)
        panel.legend(frameon=False, loc="lower right")
        plot.tight_layout()
        file = io.BytesIO()
        plot.savefig(file, format="png")
    return np.ascontiguousarray(iio.imread(file.getvalue(), extension=".png")[..., :3])
