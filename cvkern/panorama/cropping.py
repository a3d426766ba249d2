"""The largest rectangle within a panorama."""

from __future__ import annotations

import math

import numpy as np

EXACT_PIXELS = 250_000  # larger masks are searched in blocks of pixels


def largest_rectangle(mask: np.ndarray) -> tuple[int, int, int, int]:
    """Return the largest covered rectangle: first row and column, then one past the last ones.

    Masks of more than `EXACT_PIXELS` are searched in blocks that are covered completely. Among
    equal rectangles the first one from the top wins. An empty mask gives the whole mask.
    """
    size = max(1, math.ceil(math.sqrt(mask.size / EXACT_PIXELS)))
    height, width = (n // size for n in mask.shape)
    blocks = mask[: height * size, : width * size].reshape(height, size, width, size)
    whole = np.asarray(blocks.all(axis=(1, 3)))
    best, found = 0, (0, 0, mask.shape[0], mask.shape[1])
    heights = np.zeros(width + 1, np.int64)
    for row in range(height):
        heights[:width] = np.where(whole[row], heights[:width] + 1, 0)
        if int(heights.max()) * width <= best:
            continue
        area, left, right, tall = _in_histogram(heights.tolist())
        if area > best:
            best = area
            found = ((row + 1 - tall) * size, left * size, (row + 1) * size, right * size)
    return found


def _in_histogram(heights: list[int]) -> tuple[int, int, int, int]:
    """Return area, left, right and height of the largest rectangle; the last height must be 0."""
    best = (0, 0, 0, 0)
    stack: list[tuple[int, int]] = []  # first column of a height, and the height; heights ascend
    for place, height in enumerate(heights):
        begin = place
        # Each column is pushed once, so it is popped at most once.
        while stack and stack[-1][1] >= height:
            begin, tall = stack.pop()
            area = tall * (place - begin)
            if area > best[0]:
                best = (area, begin, place, tall)
        stack.append((begin, height))
    return best
