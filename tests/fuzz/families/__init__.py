"""How each public function is called: a maker for each of its parameters, family by family."""

from __future__ import annotations

import importlib
import pkgutil
from functools import lru_cache
from itertools import zip_longest
from typing import Any

import numpy as np

from tests.fuzz.arguments import NONSENSE, Call, Draw
from tests.fuzz.disguises import disguised, gathered

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


# Calls that take about 9 to 20 ms with both sets come in one later round of two, those that take
# longer in one of four. A million calls are 5000 of a function, 3000, or 2000.
PERIODS: dict[int, set[str]] = {
    2: {"StereoMatcher", "clouds.turntable", "demosaic", "detect_shape", "find_essential",
        "find_fundamental", "find_fundamentals", "find_homographies", "integrate_normals",
        "radiance.fit", "radiance.load_model", "radiance.planes_from_stereo",
        "radiance.write_planes", "retinex", "scale.apply canny", "subpixel_edges of stacks"},
    4: {"ShapeModel", "adjust_bundle", "calibrate_camera", "calibrate_projector",
        "calibrate_stereo", "estimate_lights", "find_essentials", "match_photographs",
        "merge_exposures", "metamer", "photometric_stereo", "radiance.make_scene",
        "radiance.write_splats", "recognize_panoramas", "reconstruct", "reconstruct_pair",
        "scale.recognize_panoramas", "scale.stitch", "shape_from_shading", "stitch"},
}  # fmt: skip
LATER = max(PERIODS)
PERIOD = {name: period for period, names in PERIODS.items() for name in names}


@lru_cache
def turns(family: str) -> list[str]:
    """Return the calls of all rounds, in their order, family by turns.

    The first round has all of them, those that take longest last.
    """
    groups = [FAMILIES[family]] if family else FAMILIES.values()
    every = [name for names in zip_longest(*groups) for name in names if name]
    order = sorted(every, key=lambda name: PERIOD.get(name, 1))
    for after in range(LATER):
        order += [name for n, name in enumerate(every) if (after + n) % PERIOD.get(name, 1) == 0]
    return order


@lru_cache
def parts(family: str, count: int) -> dict[str, int]:
    """Return which of so many parts each call belongs to.

    Calls of one family, which share kernels, are mostly in one part, so that each process
    compiles only a part of all kernels. All parts take about as long.
    """
    names = [name for calls in FAMILIES.values() for name in calls]
    load = np.cumsum([turns(family).count(name) * PERIOD.get(name, 1) for name in names])
    return dict(zip(names, (count * (load - 1) // load[-1]).tolist(), strict=True))


def name_of(index: int, family: str = "") -> str:
    """Return the name of a call by its number.

    The functions take turns, all of them or those of a family.
    """
    order = turns(family)
    return order[index % len(order)]


def draw_call(draw: Draw, index: int, family: str = "") -> tuple[str, dict[str, Any]]:
    """Return the name of a call and its arguments, one of which may be nonsense."""
    name = name_of(index, family)
    call = CALLS[name]
    chosen = {key: make(draw) for key, make in call.needed.items()}
    chosen |= {key: make(draw) for key, make in call.options.items() if draw.odd(0.35)}
    if draw.odd(0.2):
        chosen[draw.pick([*call.needed, *call.options])] = draw.pick(NONSENSE)
    arrays = [key for key, value in chosen.items() if type(value) is np.ndarray and key != "out"]
    if arrays and draw.odd(0.05):
        key = draw.pick(arrays)
        chosen[key] = disguised(draw, chosen[key])
    lists = [key for key, value in chosen.items() if type(value) is list and value]
    if lists and draw.odd(0.05):
        key = draw.pick(lists)
        chosen[key] = gathered(draw, chosen[key])
    return name, chosen
