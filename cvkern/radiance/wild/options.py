"""The options for photographs of changing light and of crowds."""

from __future__ import annotations

from typing import NamedTuple

from cvkern._checks import check_choice, check_flag, check_integer
from cvkern.radiance.models import APPEARANCES, Model
from cvkern.radiance.scenes.photographs import Scene


class Wild(NamedTuple):
    """How a field copes with such photographs; :func:`cvkern.radiance.fit` explains each."""

    appearance: str | None
    gauge: int | None
    robust: bool
    transient: bool


def check_wild(scene: Scene, loss: str, wild: Wild) -> Wild:
    """Check the options for changing light and crowds, and which go together."""
    gauge = wild.gauge
    if wild.appearance is not None:
        check_choice(wild.appearance, tuple(APPEARANCES), "appearance")
    elif gauge is not None:
        raise ValueError(f"gauge must go with an appearance, got {gauge} alone")
    if gauge is not None and scene.test[check_integer(gauge, "gauge", 0, len(scene) - 1)]:
        raise ValueError(f"gauge must be a photograph that is trained on, got {gauge}, held out")
    robust = check_flag(wild.robust, "robust")
    transient = check_flag(wild.transient, "transient")
    if transient and (robust or loss != "squared"):
        other = "robust" if robust else f"the loss {loss!r}"
        raise ValueError(f"transient must not go with {other}, got both")
    return wild._replace(robust=robust, transient=transient)


def check_whole(scene: Scene, spread: float, wild: Wild | Model) -> None:
    """Check the options of a field whose batches are whole photographs."""
    beside = "robust" if wild.robust else "transient" if wild.transient else None
    if scene.masks is not None and beside is not None:
        raise ValueError(f"{beside} must not go with masks for splats, got both")
    if spread > 0:
        raise ValueError(f"spread must be 0 for splats, got {spread:g}")
