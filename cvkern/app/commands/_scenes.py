"""Scenes and fields, as the options of ``cvkern nerf`` name them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from cvkern.app.commands.cameras import reconstructed, without_cameras

SHAPES, FORWARD = "shapes", "shapes-forward"  # names of synthetic scenes
SceneAt = Annotated[
    Path,
    typer.Argument(
        metavar="SCENE",
        help=f"Folder of photographs, or '{SHAPES}' for a synthetic scene, '{FORWARD}' for one "
        "photographed from one side. If no file there has the cameras, they are found.",
    ),
]


def within(scene: Any, bounds: str | None, near: float | None, far: float | None) -> Any:
    """Return the scene with the bounds that are given."""
    from dataclasses import replace

    from cvkern.radiance import Bounds
    from cvkern.radiance.scenes._blender import warn_of_past

    if bounds is not None:
        try:
            x, y, z, half = map(float, bounds.split(","))
        except ValueError:
            raise ValueError(f"bounds must be X,Y,Z,HALF, got {bounds!r}") from None
        cube = Bounds((x, y, z), half, scene.bounds.unbounded)
        scene = replace(scene, bounds=cube)
        if not cube.unbounded:
            warn_of_past(scene.cameras, cube, "", "give other bounds")
    given = {name: value for name, value in (("near", near), ("far", far)) if value is not None}
    return replace(scene, **given) if given else scene


def with_settings(field: str | None, settings: list[str]) -> Any:
    """Return the field that suits the device, with the settings that are given."""
    import json
    from dataclasses import fields, replace

    from cvkern._checks import check_choice
    from cvkern.radiance.training import KINDS, suited

    if field is not None:
        check_choice(field, tuple(KINDS), "field")
    made, found = suited(field), {}
    types = {f.name: str(f.type) for f in fields(made)}
    for setting in settings:
        name, _, text = setting.partition("=")
        check_choice(name, tuple(types), "set")
        try:
            value = text if "str" in types[name] else json.loads(text)
        except ValueError:
            raise ValueError(f"set must be NAME=VALUE with a number, got {setting!r}") from None
        several = "tuple" in types[name] and not isinstance(value, list)
        found[name] = (value,) if several else tuple(value) if isinstance(value, list) else value
    return replace(made, **found)


def scene_at(path: Path, shrink: int, test_every: int = 8) -> Any:
    """Return the scene of a folder, or the synthetic one, averaged over blocks of pixels."""
    from cvkern._checks import check_integer
    from cvkern.radiance import load_scene, make_scene

    layouts = {SHAPES: "around", FORWARD: "forward"}
    if str(path) in layouts and not path.exists():
        scene = make_scene(layout=layouts[str(path)])
    else:
        read = reconstructed if without_cameras(path) else load_scene
        scene = read(path, test_every=test_every)
    check_integer(shrink, "shrink", 1, min(scene.cameras.width, scene.cameras.height))
    return scene if shrink == 1 else scene.resized(shrink)


def fade(model: Any, first: int | None, last: int | None, frames: int) -> Any:
    """Return the lights of a film from that of one photograph to that of another, if given."""
    from cvkern._checks import check_integer

    if last is None:
        return first
    lights, begin = model.appearances, model.gauge if first is None else first
    for name, number in (("light", begin), ("light-to", last)):
        check_integer(number, name, 0, len(lights) - 1)
    share = np.linspace(0, 1, frames).reshape(-1, *(1,) * (lights.ndim - 1))
    return (1 - share) * lights[begin] + share * lights[last]


def check_kind(film: bool, depth: Path | None, light_to: int | None) -> None:
    """Refuse options of a single view for a film, and of a film for a single view."""
    if film and depth:
        raise ValueError(f"depth must go with a single view, got {str(depth)!r} with a film")
    if light_to is not None and not film:
        raise ValueError(f"light-to must go with a film, got {light_to} with a single view")
