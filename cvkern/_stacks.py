"""Stacks of images for functions whose results differ in length from image to image."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cvkern._checks import check_photograph


def one_by_one(function: Callable[..., Any], options: dict[str, Any], name: str = "image") -> Any:
    """Return a list with the result of `function` for each image of a stack.

    `options` are all arguments of `function` as the caller gave them; `name` is that of the stack.
    """
    batch_axis = options["batch_axis"]
    images = check_photograph(options[name], name, batch_axis)
    alone = {**options, "batch_axis": None}
    return [function(**{**alone, name: images[n]}) for n in range(images.shape[0])]
