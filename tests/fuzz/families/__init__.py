"""How each public function is called: a maker for each of its parameters, family by family."""

from __future__ import annotations

import importlib
import pkgutil
from functools import lru_cache
from itertools import zip_longest
from typing import Any

import numpy as np

from tests.fuzz.arguments import NONSENSE, Call, Draw, disguised

# The calls of each module of this package, by its name.
FAMILIES: dict[str, dict[str, Call]] = {
    module: importlib.import_module(f"{__name__}.{module}").CALLS
    for module in sorted(info.name for info in pkgutil.iter_modules(__path__))
}
CALLS: dict[str, Call] = {name: call for calls in FAMILIES.values() for name, call in calls.items()}
TORCH = "it takes tensors of PyTorch, which may not be there; tests of its own try it"
# Public functions that are not called, and why.
NOT_CALLED = {
    "devices": "it names what is there, and has one option, which test_runtime.py tries",
    "release_memory": "it takes no arguments; test_memory.py calls it between others",
    "torch.composite_rays": TORCH,
    "torch.gaussian": TORCH,
    "torch.remap": TORCH,
}


# Calls that take more than 10 ms with both sets come in one round of so many, and those of more
# than 100 ms in one round of more.
SELDOM, RARELY = 16, 128
COSTLY = {"find_affine", "find_homography", "find_homographies", "find_similarity", "develop",
          "find_essentials", "find_fundamentals", "find_fundamental", "detect_segments",
          "detect_lines", "detect_shape", "radiance.load_model", "find_planes", "calibrate_camera",
          "integrate_normals", "estimate_response", "merge_exposures", "metamer", "undistort",
          "generalized_hough", "detect_circles", "radiance.render_path", "orb",
          "sift", "stereo_match"}  # fmt: skip
SLOW = {"make_scan", "radiance.evaluate", "radiance.fit", "radiance.make_scene", "reconstruct_pair",
        "recognize_panoramas", "reconstruct", "stitch", "ShapeModel", "calibrate_projector",
        "calibrate_stereo", "estimate_lights", "shape_from_shading"}  # fmt: skip


@lru_cache
def turns(family: str) -> list[str]:
    """Return the calls of all rounds, in their order, family by turns.

    The first round has all of them, those that cost most last.
    """
    groups = [FAMILIES[family]] if family else FAMILIES.values()
    every = [name for names in zip_longest(*groups) for name in names if name]
    cheap = [name for name in every if name not in COSTLY | SLOW]
    part = cheap + [name for name in every if name in COSTLY] + (SELDOM - 1) * cheap
    return (
        part[: len(every) - len(SLOW & set(every))]
        + [name for name in every if name in SLOW]
        + (SELDOM - 1) * cheap
        + (RARELY // SELDOM - 1) * part
    )


def draw_call(draw: Draw, index: int, family: str = "") -> tuple[str, dict[str, Any]]:
    """Return the name of a call and its arguments, one of which may be nonsense.

    The functions take turns, all of them or those of a family.
    """
    order = turns(family)
    name = order[index % len(order)]
    call = CALLS[name]
    chosen = {key: make(draw) for key, make in call.needed.items()}
    chosen |= {key: make(draw) for key, make in call.options.items() if draw.odd(0.35)}
    if draw.odd(0.2):
        chosen[draw.pick([*call.needed, *call.options])] = draw.pick(NONSENSE)
    arrays = [key for key, value in chosen.items() if type(value) is np.ndarray and key != "out"]
    if arrays and draw.odd(0.05):
        key = draw.pick(arrays)
        chosen[key] = disguised(draw, chosen[key])
    return name, chosen
