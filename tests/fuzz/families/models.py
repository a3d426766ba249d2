"""Radiance fields that are trained, drawn and kept: two steps of a small one."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from cvkern import radiance
from cvkern._runtime import runtime
from cvkern.images import write_image
from tests.fuzz.arguments import Call, Draw, maybe, number, one, whole

SMALL = radiance.VoxelField(resolutions=(16,), shares=(), rays=64)
CAMERAS = radiance.cameras(np.eye(4)[None, :3], [12, 12, 6, 4], 13, 9)
MOST_STEPS = 3
FACES = np.arange(9, dtype=np.int32).reshape(3, 3)
SURFACE = radiance.Mesh(np.eye(9, 3, dtype=np.float32), FACES, np.zeros((9, 3), np.uint8))


@lru_cache(1)
def scene() -> radiance.Scene:
    """Return a few small photographs."""
    return radiance.make_scene(train=4, test=1, size=12)


@lru_cache(4)
def _model_of(backend: str, device: str) -> radiance.Model:
    return radiance.fit(scene(), SMALL, steps=2, transient=True, progress=False)


def model() -> radiance.Model:
    """Return a model on the device of the call."""
    return _model_of(runtime().name, runtime().device)


@lru_cache(1)
def model_file() -> bytes:
    """Return the file of a model."""
    with tempfile.TemporaryDirectory() as folder:
        model().save(Path(folder) / "m.npz")
        return (Path(folder) / "m.npz").read_bytes()


def trained(steps: Any, **options: Any) -> float:
    """Train for a few steps; return the score of the last."""
    # It would do what it is told, or train for a minute if it is told nothing.
    if steps is None or (isinstance(steps, int) and steps > MOST_STEPS):
        raise ValueError("steps")
    made = radiance.fit(scene(), SMALL, steps=steps, progress=False, **options)
    return made.training.step


K = np.array([[9.0, 0, 4], [0, 9, 3], [0, 0, 1]])
PHOTO = np.arange(7 * 9 * 3, dtype=np.uint8).reshape(7, 9, 3)
LEFT = np.random.default_rng(0).integers(0, 256, (24, 40, 3), np.uint8)
AWAY = np.linspace(1, 4, 63, dtype=np.float32).reshape(7, 9)


def layered(image: Any, depth: Any, **options: Any) -> Any:
    """Make planes of a photograph and its depths, and render them."""
    made = radiance.planes_from_depth(image, depth, K, **options)
    return radiance.render(made, made.cameras).color


def paired(left: Any, right: Any, disparities: Any, **options: Any) -> Any:
    """Make planes of a pair, and render them."""
    made = radiance.planes_from_stereo(left, right, K, disparities=disparities, **options)
    return radiance.render(made, made.cameras).color


def paged(**options: Any) -> int:
    """Write a page of planes; return its number of characters."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        radiance.write_planes(radiance.planes_from_depth(PHOTO, AWAY, K), path, **options)
        return len(path.read_text())


def splatted(degree: Any, steps: Any, **options: Any) -> float:
    """Train splats for a few steps, write them, and read them; return their number."""
    if not isinstance(steps, int) or steps > MOST_STEPS:
        raise ValueError("steps")
    field = radiance.SplatField(splats=30, degree=degree, start="random")
    made = radiance.fit(scene(), field, steps=steps, progress=False, **options)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "splats.ply"
        radiance.write_splats(path, made)
        found = radiance.load_splats(path, made.cameras)
    assert np.isfinite(radiance.render(found, made.cameras).color).all()
    return found.settings.splats


def splats_of(content: Any) -> Any:
    """Read splats from the bytes of a file, and render them."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "splats.ply"
        _write(path, content)
        return radiance.render(radiance.load_splats(path, CAMERAS), CAMERAS).color


@lru_cache(1)
def splat_file() -> bytes:
    """Return the file of a few splats."""
    field = radiance.SplatField(splats=9, degree=1, start="random")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "splats.ply"
        radiance.write_splats(path, radiance.fit(scene(), field, steps=1, progress=False))
        return path.read_bytes()


def lit(image: Any, **options: Any) -> Any:
    """Find the light of a photograph."""
    return radiance.fit_appearance(model(), image, CAMERAS, **options)


def passing(view: Any) -> Any:
    """Show what passes in front of a photograph."""
    return radiance.render_transient(model(), view)


def rendered(cameras: Any, view: Any, background: Any = None) -> Any:
    """Render a view of a model."""
    return radiance.render(model(), cameras, view, background=background)


def filmed(cameras: Any, fps: Any = 20.0, background: Any = None) -> int:
    """Render a film of a model, and return whether it has bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.gif"
        radiance.render_path(model(), cameras, path, fps=fps, background=background)
        return path.stat().st_size > 0


def scored(test: Any = True, views: Any = None) -> Any:
    """Compare a model with photographs."""
    return radiance.evaluate(model(), scene(), test=test, views=views)


def meshed(resolution: Any, density: Any = 25.0, pieces: Any = 1) -> Any:
    """Make a mesh of a model."""
    return radiance.mesh(model(), resolution=resolution, density=density, pieces=pieces)


def clouded(cameras: Any, views: Any = None) -> Any:
    """Make points of a model."""
    return radiance.point_cloud(model(), cameras, views=views)


def loaded(content: Any) -> int:
    """Load a model from a file of any content."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "m.npz"
        _write(path, content)
        try:
            return radiance.load_model(path).training.step
        except ValueError as error:
            raise ValueError(f"path: {str(error).replace(folder, '')}") from None


def scene_of(content: Any, test_every: Any = 8) -> int:
    """Load a scene from a file of any content."""
    with tempfile.TemporaryDirectory() as folder:
        _write(Path(folder) / "transforms.json", content)
        for n in range(2):
            pixels = np.full((4, 5, 3), 50 * n, np.uint8)
            write_image(Path(folder) / f"{n}.png", pixels)
        try:
            return len(radiance.load_scene(folder, test_every=test_every).images)
        except (ValueError, TypeError, FileNotFoundError) as error:  # its docstring names them
            raise ValueError(f"path: {str(error).replace(folder, '')}") from None


def film_of(content: Any, factor: Any = 1.0) -> Any:
    """Read the cameras of a film from a file of any content."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "transforms.json"
        _write(path, content)
        try:
            return radiance.load_camera_path(path, factor=factor).cameras.poses
        except ValueError as error:
            raise ValueError(f"path: {str(error).replace(folder, '')}") from None


def written(surface: Any) -> bytes:
    """Return the file of a mesh."""
    with tempfile.TemporaryDirectory() as folder:
        radiance.write_mesh(Path(folder) / "m.ply", surface)
        return (Path(folder) / "m.ply").read_bytes()


def _write(path: Path, content: Any) -> None:
    try:
        path.write_bytes(content)
    except TypeError:
        raise TypeError("content") from None


def harmed(draw: Draw, whole: Callable[[], bytes] = model_file) -> bytes:
    """Return a model's file, a few of whose bytes are others."""
    content = bytearray(whole())
    for _ in range(int(draw.rng.integers(0, 4))):
        content[int(draw.rng.integers(len(content)))] ^= int(draw.rng.integers(1, 256))
    return bytes(content[: len(content) if draw.odd(0.8) else draw.rng.integers(len(content))])


POSE = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]"
FRAMES = ",".join(f'{{"file_path":"{n}.png","transform_matrix":{POSE}}}' for n in range(2))
TRANSFORMS = f'{{"fl_x":5,"fl_y":5,"cx":2.5,"cy":2,"w":5,"h":4,"aabb_scale":1,"frames":[{FRAMES}]}}'


def harmed_text(draw: Draw) -> bytes:
    """Return a scene's file, a few of whose words are others."""
    content = bytearray(TRANSFORMS.encode())
    for _ in range(int(draw.rng.integers(0, 4))):
        at = int(draw.rng.integers(len(content)))
        part = draw.pick([b"", b"0", b"9" * 400, b"-", b"NaN", b"]", b"null", b"\xff", b"e9", b'"'])
        content[at : at + int(draw.rng.integers(0, 9))] = part
    return bytes(content)


VIEWS = maybe(one([0], [0, 0], [], [9], [-1], np.array([True])))
BEHIND = maybe(one("white", "black", (0.1, 0.2, 0.3), (1, 2), "none"))
PLACES = one(CAMERAS, CAMERAS, CAMERAS, [])
CALLS: dict[str, Call] = {
    "radiance.fit": Call(
        trained,
        {"steps": whole(0, MOST_STEPS)},
        {
            "background": one("white", "black", "random", "learnt", "none", None),
            "loss": one("squared", "huber", "none"),
            "spread": number(0, 0.1),
            "seed": whole(0, 9),
            "deterministic": one(False, True),
            "appearance": one(None, "affine", "none"),
            "robust": one(False, True),
            "transient": one(False, True),
        },
        equal=False,
    ),
    "radiance.render_transient": Call(passing, {"view": whole(0, 5)}, {}, equal=False),
    "radiance.render": Call(
        rendered, {"cameras": PLACES, "view": whole(0, 1)}, {"background": BEHIND}, equal=False
    ),
    "radiance.render_path": Call(
        filmed, {"cameras": PLACES}, {"fps": one(20.0, 1, 0, 1e9), "background": BEHIND}
    ),
    "radiance.evaluate": Call(scored, {}, {"test": one(True, False), "views": VIEWS}, equal=False),
    "radiance.mesh": Call(
        meshed,
        {"resolution": one(2, 8, 8, 17, 1, 2**20)},
        {"density": number(0.01, 1), "pieces": maybe(whole(0, 3))},
        equal=False,
    ),
    "radiance.point_cloud": Call(clouded, {"cameras": PLACES}, {"views": VIEWS}, equal=False),
    "radiance.load_model": Call(loaded, {"content": harmed}, {}),
    "radiance.load_scene": Call(scene_of, {"content": harmed_text}, {"test_every": whole(0, 9)}),
    "radiance.load_camera_path": Call(
        film_of, {"content": harmed_text}, {"factor": number(0.2, 2)}
    ),
    "radiance.make_scene": Call(
        radiance.make_scene,
        {"size": whole(1, 12)},
        {"train": whole(0, 3), "test": whole(0, 2), "samples": whole(1, 3)},
        equal=False,
    ),
    "radiance.planes_from_depth": Call(
        layered,
        {"image": one(PHOTO, PHOTO / 255, PHOTO[..., 0]), "depth": one(AWAY, -AWAY, AWAY.T)},
        {"planes": whole(1, 5), "reach": whole(0, 4)},
        equal=False,
    ),
    "radiance.planes_from_stereo": Call(
        paired,
        {
            "left": one(LEFT, LEFT[:, 1:]),
            "right": one(np.roll(LEFT, -2, 1), LEFT),
            "disparities": one((0, 4), (1, 4)),
        },
        {"planes": whole(1, 5), "baseline": number(0.5, 2), "doffs": number(0.5, 3)},
        equal=False,
    ),
    "radiance.write_planes": Call(paged, {}, {"motion": number(0, 1)}, equal=False),
    "radiance.write_splats": Call(
        splatted,
        {"degree": whole(0, 4), "steps": whole(0, MOST_STEPS)},
        {"background": one("white", "learnt"), "appearance": one(None, "affine")},
        equal=False,
    ),
    "radiance.load_splats": Call(
        splats_of, {"content": partial(harmed, whole=splat_file)}, {}, equal=False
    ),
    "radiance.fit_appearance": Call(
        lit,
        {"image": one(np.zeros((9, 13, 3), np.uint8), PHOTO)},
        {"mask": one(np.ones((9, 13), bool), np.zeros((9, 13), bool))},
        equal=False,
    ),
    "radiance.write_mesh": Call(
        written,
        {"surface": one(SURFACE, SURFACE._replace(faces=FACES[:0]), SURFACE._replace(faces=[]))},
        {},
    ),
}
